// Look at pages in a browser: accessibility (axe), sideways scrolling, requests, pictures, print.
//
//     cd /tmp && npm install axe-core puppeteer-core     (and a chromium: CHROMIUM=/usr/bin/chromium)
//     NODE_PATH=/tmp/node_modules node tools/check_pages.mjs OUT report.html index.html
//
// Writes OUT/NAME-WIDTH-SCHEME.png and OUT/NAME.pdf. Ends with 1 where axe finds something serious,
// the page is wider than its window or asks for anything from elsewhere.
import { mkdirSync } from "node:fs";
import { createRequire } from "node:module";
import { basename, resolve } from "node:path";
import { pathToFileURL } from "node:url";

const require = createRequire(import.meta.url);
const { source } = require("axe-core"), puppeteer = require("puppeteer-core");
const [out, ...files] = process.argv.slice(2);
mkdirSync(out, { recursive: true });
const browser = await puppeteer.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args: ["--no-sandbox"],
});
let faults = 0;
for (const file of files)
  for (const scheme of ["light", "dark"])
    for (const width of [400, 800, 1400]) {
      const fault = (...words) => { faults++; console.log(file, scheme, width, ...words); };
      const page = await browser.newPage(), name = `${out}/${basename(file, ".html")}`;
      page.on("request", (r) => /^(file|data):/.test(r.url()) || fault("asks for", r.url()));
      page.on("pageerror", (error) => fault(error.message));
      page.on("console", (message) => fault(message.text())); // a script that its policy refuses
      await page.setViewport({ width, height: 900 });
      await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: scheme }]);
      await page.goto(pathToFileURL(resolve(file)).href);
      const beyond = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
      if (beyond > 0) fault("is wider than its window by", beyond);
      await page.screenshot({ path: `${name}-${width}-${scheme}.png`, fullPage: true });
      await page.evaluate(source);
      // preload: axe would ask for style sheets, which a browser refuses to a page from a disk
      const { violations } = await page.evaluate(() => globalThis.axe.run({ preload: false }));
      for (const { id, impact, nodes } of violations)
        if (["serious", "critical"].includes(impact)) fault(impact, id, nodes[0].html.slice(0, 150));
        else console.log(file, scheme, width, impact, id);
      if (width === 1400 && scheme === "light")
        await page.pdf({ path: `${name}.pdf`, format: "A4", printBackground: true });
      await page.close();
    }
await browser.close();
console.log(faults ? `${faults} faults` : "no fault");
process.exit(faults ? 1 : 0);
