// What three.js says of a glTF file: a line for each warning, error and missing file.
// Run in viewer/, where its package is: node --input-type=module - FILE < ../benchmarks/read_with_three.mjs
import { readFileSync } from "node:fs";
import { dirname } from "node:path";
import { Texture } from "three";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";

const path = process.argv.at(-1);
const said = [];
for (const kind of ["warn", "error"]) console[kind] = (...words) => said.push(words.join(" "));

// What browsers have: files by URL, as the loader asks for them.
globalThis.self = globalThis;
globalThis.ProgressEvent = class {};
globalThis.Request = class {
  constructor(url) {
    this.url = url;
  }
};
globalThis.fetch = async (request) => {
  const url = String(request.url ?? request);
  if (url.startsWith("data:")) return new Response(Buffer.from(url.split(",")[1], "base64"));
  return new Response(readFileSync(decodeURIComponent(url.replace("file://", ""))));
};

const loader = new GLTFLoader();
loader.register((parser) => ({
  name: "pictures", // are found, but not decoded
  loadTexture: async (index) => {
    const uri = parser.json.images[parser.json.textures[index].source].uri;
    if (uri && !uri.startsWith("data:")) readFileSync(`${dirname(path)}/${decodeURIComponent(uri)}`);
    return new Texture();
  },
}));
const data = readFileSync(path);
const buffer = data.buffer.slice(data.byteOffset, data.byteOffset + data.byteLength);
try {
  const content = path.endsWith(".gltf") ? new TextDecoder().decode(data) : buffer;
  const found = await loader.parseAsync(content, `file://${dirname(path)}/`);
  let meshes = 0;
  found.scene.traverse((thing) => {
    meshes += thing.isMesh ? 1 : 0;
  });
  if (!meshes) said.push("no mesh");
} catch (error) {
  said.push(`${error}`);
}
for (const line of said) process.stdout.write(`${line}\n`);
