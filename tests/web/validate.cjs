// Runs the Khronos glTF validator. In: paths of .glb files. Out: a JSON object on stdout, path to the validator's report.
"use strict";
const fs = require("node:fs");
const path = require("node:path");
const validator = require("gltf-validator");

async function main(files) {
  const reports = {};
  for (const file of files) {
    const load = (uri) => fs.promises.readFile(path.join(path.dirname(file), decodeURIComponent(uri)));
    const options = { uri: path.basename(file), externalResourceFunction: load };
    reports[file] = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)), options);
  }
  process.stdout.write(JSON.stringify(reports));
}

main(process.argv.slice(2));
