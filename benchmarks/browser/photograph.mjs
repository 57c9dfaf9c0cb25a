// Photographs a page: node photograph.mjs FOLDER PAGE PICTURE.png WIDTHxHEIGHT
//
// Serves FOLDER on 127.0.0.1 and takes the picture when the network is idle and frames have been drawn. The page's
// messages go to standard output. Chromium: $CHROMIUM, else /usr/bin/chromium.
import { readFile } from "node:fs/promises";
import { createServer } from "node:http";
import { extname, join } from "node:path";
import puppeteer from "puppeteer-core";

const [folder, page, picture, size] = process.argv.slice(2);
const [width, height] = size.split("x").map(Number);
const types = { ".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".glb": "model/gltf-binary" };

const server = createServer(async (request, response) => {
  const path = decodeURIComponent(new URL(request.url, "http://x").pathname);
  const body = await readFile(join(folder, path)).catch(() => null);
  response.writeHead(body ? 200 : 404, { "content-type": types[extname(path)] ?? "application/octet-stream" });
  response.end(body ?? "");
});
await new Promise((ready) => server.listen(0, "127.0.0.1", ready));

const browser = await puppeteer.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
         "--force-color-profile=srgb", "--hide-scrollbars"],
  defaultViewport: { width, height },
});
const tab = await browser.newPage();
tab.on("console", (message) => console.log(message.text()));
tab.on("pageerror", (error) => { console.log(error.message); process.exitCode = 1; });
await tab.goto(`http://127.0.0.1:${server.address().port}/${page}`, { waitUntil: "networkidle0" });
await tab.evaluate(() => new Promise((drawn) => setTimeout(drawn, 1000)));
await tab.screenshot({ path: picture });
await browser.close();
server.close();
