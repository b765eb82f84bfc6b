// Takes a picture of a lit GLB from its own camera, with the EXR pages beside it. In: CHROMIUM LIT.glb OUT.jpg or
// OUT.png [EXPOSURE [WIDTH HEIGHT]]. The pictures of the README are made with it:
//   NODE_PATH=.deps/npm/node_modules node tests/web/picture.cjs chromium lightmaps/dungeon/dungeon.lit.glb docs/images/dungeon.jpg 2
"use strict";
const fs = require("node:fs");
const os = require("node:os");
const path = require("node:path");
const { withPage } = require("./browser.cjs");

async function main([chromium, glb, out, exposure = "1", width = "1200", height = "800"]) {
  const folder = path.dirname(glb);
  const pages = {};
  for (const name of fs.readdirSync(folder).filter((n) => n.endsWith(".exr"))) {
    pages[name] = fs.readFileSync(path.join(folder, name)).toString("base64");
  }
  const input = [fs.readFileSync(glb).toString("base64"), pages, Number(exposure), Number(width), Number(height)];
  input.push(out.endsWith(".png") ? "image/png" : "image/jpeg");
  const work = fs.mkdtempSync(path.join(os.tmpdir(), "picture-"));
  const url = await withPage(chromium, work, (tab) => tab.evaluate((...args) => window.picture(...args), ...input));
  fs.writeFileSync(out, Buffer.from(url.split(",")[1], "base64"));
  fs.rmSync(work, { recursive: true });
}

main(process.argv.slice(2)).catch((error) => {
  console.error(error);
  process.exitCode = 1;
});
