// Opens page.js with a lit GLB in headless Chromium. In: CHROMIUM GLB PROBES.json WORK_FOLDER.
// Out: a JSON object on stdout, {"lightmapped": meshes with a lightmap, "radiance": [[r, g, b], ...]}.
"use strict";
const fs = require("node:fs");
const path = require("node:path");
const { pathToFileURL } = require("node:url");
const esbuild = require("esbuild");
const puppeteer = require("puppeteer-core");

// SwiftShader renders without a GPU and has float render targets.
const FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"];

async function main([chromium, glb, probes, folder]) {
  const page = path.join(folder, "page.html");
  const bundle = await esbuild.build({
    entryPoints: [path.join(__dirname, "page.js")],
    bundle: true,
    format: "iife",
    write: false,
    nodePaths: (process.env.NODE_PATH ?? "").split(path.delimiter),
  });
  // A closing tag inside the bundle would end the script element.
  const script = bundle.outputFiles[0].text.replaceAll("</script", "<\\/script");
  fs.writeFileSync(page, `<!doctype html><meta charset="utf-8"><title>Lightmap</title><script>${script}</script>`);

  const browser = await puppeteer.launch({ executablePath: chromium, args: FLAGS, userDataDir: path.join(folder, "profile") });
  try {
    const tab = await browser.newPage();
    tab.on("pageerror", (error) => console.error(error.message));
    tab.on("console", (message) => console.error(message.text()));
    await tab.goto(pathToFileURL(page).href);
    const input = [fs.readFileSync(glb).toString("base64"), JSON.parse(fs.readFileSync(probes, "utf8"))];
    const result = await tab.evaluate((data, points) => window.measure(data, points), ...input);
    process.stdout.write(JSON.stringify(result));
  } finally {
    await browser.close();
  }
}

main(process.argv.slice(2)).catch((error) => {
  console.error(error);
  process.exitCode = 1;
});
