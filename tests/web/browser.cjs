// Opens page.js in headless Chromium. Out: the tab, and what closes it.
"use strict";
const fs = require("node:fs");
const path = require("node:path");
const { pathToFileURL } = require("node:url");
const esbuild = require("esbuild");
const puppeteer = require("puppeteer-core");

// SwiftShader renders without a GPU and has float render targets.
const FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"];

/** Bundles page.js into one file in `folder`, opens it, and passes the tab to `work`. */
async function withPage(chromium, folder, work) {
  const bundle = await esbuild.build({
    entryPoints: [path.join(__dirname, "page.js")],
    bundle: true,
    format: "iife",
    write: false,
    nodePaths: (process.env.NODE_PATH ?? "").split(path.delimiter),
  });
  // A closing tag inside the bundle would end the script element.
  const script = bundle.outputFiles[0].text.replaceAll("</script", "<\\/script");
  const html = `<!doctype html><meta charset="utf-8"><title>Lightmap</title><body style="margin:0"><script>${script}</script>`;
  const page = path.join(folder, "page.html");
  fs.writeFileSync(page, html);

  const browser = await puppeteer.launch({ executablePath: chromium, args: FLAGS, userDataDir: path.join(folder, "profile") });
  try {
    const tab = await browser.newPage();
    tab.on("pageerror", (error) => console.error(error.message));
    tab.on("console", (message) => console.error(message.text()));
    await tab.goto(pathToFileURL(page).href);
    return await work(tab);
  } finally {
    await browser.close();
  }
}

module.exports = { withPage };
