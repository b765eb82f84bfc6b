// Measures what three.js draws. In: CHROMIUM LIT.glb PROBES.json WORK_FOLDER.
// Out: a JSON object on stdout, {"lightmapped": meshes with a lightmap, "radiance": [[r, g, b], ...]}.
"use strict";
const fs = require("node:fs");
const { withPage } = require("./browser.cjs");

async function main([chromium, glb, probes, folder]) {
  const input = [fs.readFileSync(glb).toString("base64"), JSON.parse(fs.readFileSync(probes, "utf8"))];
  const result = await withPage(chromium, folder, (tab) =>
    tab.evaluate((data, points) => window.measure(data, points), ...input),
  );
  process.stdout.write(JSON.stringify(result));
}

main(process.argv.slice(2)).catch((error) => {
  console.error(error);
  process.exitCode = 1;
});
