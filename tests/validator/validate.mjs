// Holds glTF and GLB files to Khronos' validator: `node validate.mjs FILE...`
// prints {"FILE": [{"code", "message", "severity", "pointer"}, ...], ...}; severity: 0 error, 1 warning, 2 information, 3 hint.
// What a file refers to is looked for beside it.

import { readFile } from "node:fs/promises";
import { dirname, join } from "node:path";
import validator from "gltf-validator";

const issuesOf = async (file) => {
  const report = await validator.validateBytes(new Uint8Array(await readFile(file)), {
    format: file.toLowerCase().endsWith(".glb") ? "glb" : "gltf",
    maxIssues: 0, // all of them
    externalResourceFunction: async (uri) => new Uint8Array(await readFile(join(dirname(file), decodeURIComponent(uri)))),
  });
  return report.issues.messages;
};

const found = {};
for (const file of process.argv.slice(2)) found[file] = await issuesOf(file);
console.log(JSON.stringify(found));
