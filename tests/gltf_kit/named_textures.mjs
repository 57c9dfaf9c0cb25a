// The pictures that extras of materials name, as three.js finds them: `node named_textures.mjs THREE FILE.glb` prints JSON,
// {"MATERIAL": {"NAME": {"file", "flipY", "colorSpace", "channel", "space", "green"}, ...}, ...}. THREE is the folder of three.js.
// For the decoded picture stands its file, as base64: node decodes none.

import { readFile } from "node:fs/promises";

globalThis.self = globalThis; // as in browsers, which the loader expects
globalThis.ProgressEvent = class {};
globalThis.createImageBitmap = async (blob) => ({ file: Buffer.from(await blob.arrayBuffer()).toString("base64") });

const [three, file] = process.argv.slice(2);
const { GLTFLoader } = await import(`${three}/examples/jsm/loaders/GLTFLoader.js`);

const { parser } = await new GLTFLoader().parseAsync(new Uint8Array(await readFile(file)).buffer, "");
const found = {};
for (const { name, userData } of await parser.getDependencies("material")) {
  found[name] = {};
  for (const [slot, info] of Object.entries(userData.aoprecalc)) {
    const { image, flipY, colorSpace, channel } = await parser.assignTexture({}, slot, info);
    found[name][slot] = { ...image, flipY, colorSpace, channel, space: info.space, green: info.green };
  }
}
console.log(JSON.stringify(found));
