// Shows baked ambient occlusion in a real browser: renders a glTF document with
// three.js in ambient light only, with and without its occlusion texture,
// writes PNGs and prints what was measured as JSON.
//
//   npm install      (in this folder; and a Chromium: apt install chromium)
//   node render.mjs out/car.glb --reference car.gltf -o pictures
//
// Everything is served on 127.0.0.1, from the documents' own folders. Pictures
// that a document names and that are not there are answered with a white one.
import { createServer } from "node:http";
import { readFile, mkdir, writeFile, realpath } from "node:fs/promises";
import { accessSync } from "node:fs";
import { dirname, basename, extname, join, resolve, sep } from "node:path";
import { fileURLToPath } from "node:url";
import { parseArgs } from "node:util";
import puppeteer from "puppeteer-core";

const USAGE = `usage: node render.mjs DOCUMENT [options]
  --reference DOCUMENT    one of the same shape, whose own occlusion texture is compared with
  -o, --output FOLDER     where the PNGs and <stem>.json go        [default: .]
  --size WxH              of the pictures                          [default: 1000x750]
  --view NAME=AZ,EL[,ZOOM[,X,Y,Z]]
                          degrees around and above; X,Y,Z: the point looked at, as
                          shares of the bounding box. May be repeated.
                          [default: front=35,20]
  --hide MATERIAL         not drawn. May be repeated.
  --no-stand-ins          answer missing pictures with 404, not with white
  --chromium FILE         [default: $CHROMIUM, else chromium of $PATH]`;

const here = dirname(fileURLToPath(import.meta.url));
const { values, positionals } = parseArgs({
  allowPositionals: true,
  options: {
    reference: { type: "string" },
    output: { type: "string", short: "o", default: "." },
    size: { type: "string", default: "1000x750" },
    view: { type: "string", multiple: true, default: ["front=35,20"] },
    hide: { type: "string", multiple: true, default: [] },
    "no-stand-ins": { type: "boolean", default: false },
    chromium: { type: "string" },
    help: { type: "boolean", short: "h", default: false },
  },
});
if (values.help || positionals.length !== 1) {
  console.error(USAGE);
  process.exit(values.help ? 0 : 2);
}

const [width, height] = values.size.split("x").map(Number);
const views = values.view.map((text) => {
  const [name, numbers] = text.split("=");
  const [azimuth, elevation, zoom = 1, ...target] = numbers.split(",").map(Number);
  return { name, azimuth, elevation, zoom, target: target.length === 3 ? target : null };
});

const WHITE = Buffer.from("iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR4nGP4////fwAJ+wP9KobjigAAAABJRU5ErkJggg==", "base64");
const TYPES = {
  ".html": "text/html", ".js": "text/javascript", ".json": "application/json",
  ".gltf": "model/gltf+json", ".glb": "model/gltf-binary", ".bin": "application/octet-stream",
  ".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".webp": "image/webp",
};
const missing = new Set();

function threeFolder() {
  for (let folder = here; ; folder = dirname(folder)) {
    const found = join(folder, "node_modules", "three");
    try { accessSync(join(found, "package.json")); return found; } catch { /* one up */ }
    if (folder === dirname(folder)) throw new Error("three is not installed: npm install three");
  }
}

async function serve(roots) {
  const server = createServer(async (request, response) => {
    const path = decodeURIComponent(new URL(request.url, "http://x").pathname);
    const [, first, ...rest] = path.split("/");
    const root = roots[first];
    const answer = (status, type, body) => {
      response.writeHead(status, { "content-type": type, "cache-control": "no-store" });
      response.end(body);
    };
    if (path === "/") return answer(200, TYPES[".html"], await readFile(join(here, "page.html")));
    if (!root) return answer(path === "/favicon.ico" ? 204 : 404, "text/plain", "");
    const file = resolve(root, rest.join("/"));
    const type = TYPES[extname(file).toLowerCase()] ?? "application/octet-stream";
    try {
      const real = await realpath(file);
      if (!real.startsWith((await realpath(root)) + sep)) return answer(403, "text/plain", "");
      return answer(200, type, await readFile(real));
    } catch {
      if (type.startsWith("image/")) {
        missing.add(path);
        if (!values["no-stand-ins"]) return answer(200, "image/png", WHITE);
      }
      return answer(404, "text/plain", "");
    }
  });
  await new Promise((done) => server.listen(0, "127.0.0.1", done));
  return server;
}

const folder = (file) => dirname(resolve(file));
const server = await serve({
  three: threeFolder(), document: folder(positionals[0]),
  ...(values.reference && { reference: folder(values.reference) }),
});
const base = `http://127.0.0.1:${server.address().port}/`;
const address = (root, file) => `${base}${root}/${encodeURIComponent(basename(file))}`;

const browser = await puppeteer.launch({
  executablePath: values.chromium ?? process.env.CHROMIUM
    ?? (process.env.PATH ?? "").split(":").map((at) => join(at, "chromium"))
      .find((at) => { try { accessSync(at); return true; } catch { return false; } }),
  headless: true,
  args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
         "--force-color-profile=srgb", "--hide-scrollbars"],
  defaultViewport: { width, height },
  protocolTimeout: 600_000,
});

try {
  const page = await browser.newPage();
  const messages = [];
  page.on("console", (message) => messages.push(`${message.type()}: ${message.text()}`));
  page.on("pageerror", (error) => messages.push(`pageerror: ${error.message}`));
  await page.goto(base);
  await page.waitForFunction(() => document.title === "ready");

  const call = (name, ...args) => page.evaluate((n, a) => window.aoCheck[n](...a), name, args);
  const result = { chromium: await browser.version(), ...(await call("start", width, height)) };
  result.document = await call("load", "document", address("document", positionals[0]));
  if (values.reference)
    result.reference = await call("load", "reference", address("reference", values.reference));

  await mkdir(values.output, { recursive: true });
  const stem = basename(positionals[0], extname(positionals[0]));
  const { hide } = values;
  result.views = {};
  for (const view of views) {
    const shots = [["document", "ao"], ["document", "none"]];
    if (values.reference) shots.push(["reference", "ao"]);
    const files = [];
    for (const [name, mode] of shots) {
      await call("draw", { name, mode, view, hide, frame: "document" });
      const label = name === "reference" ? "reference" : mode;
      const file = join(values.output, `${stem}_${view.name}_${label}.png`);
      await page.screenshot({ path: file, clip: { x: 0, y: 0, width, height } });
      files.push(basename(file));
    }
    result.views[view.name] = {
      files, ray: await call("ray", { name: "document", view }),
      ...(await call("measure", { name: "document", view, hide,
                                  reference: values.reference ? "reference" : null })),
    };
  }
  result.missingPictures = [...missing].map((path) => path.slice(1));
  result.messages = messages;
  const text = JSON.stringify(result, null, 1);
  await writeFile(join(values.output, `${stem}.json`), text + "\n");
  console.log(text);
} finally {
  await browser.close();
  server.close();
}
