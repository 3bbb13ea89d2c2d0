// Drives VS Code in a browser: node code_server.mjs TOOLS URL FILE CHROMIUM, a line of JSON for each
// answer. TOOLS is the folder with puppeteer-core, URL that of a code-server without a password.
import { createRequire } from "node:module";
const [, , tools, url, file, chromium] = process.argv;
const puppeteer = createRequire(`${tools}/`)("puppeteer-core");

const told = (what, value) => console.log(JSON.stringify([what, value]));
const browser = await puppeteer.launch({
  executablePath: chromium, headless: true, defaultViewport: {width: 1400, height: 900},
  args: ["--no-sandbox", "--disable-quic", "--disable-background-networking"],
});
const page = await browser.newPage();
page.setDefaultTimeout(60_000);
const pressed = async (...keys) => {
  for (const key of keys) await page.keyboard.down(key);
  for (const key of keys.reverse()) await page.keyboard.up(key);
};
const lines = () => page.$eval(".view-lines", each => each.innerText.replaceAll("\u00a0", " ").split("\n").sort());
const until = (holds, ...values) => page.waitForFunction(holds, {}, ...values);
const has = text => until(
  each => document.querySelector(".view-lines").innerText.replaceAll("\u00a0", " ").includes(each), text);
try {
  const opened = JSON.stringify([["openFile", `vscode-remote://${new URL(url).host}${file}`]]);
  await page.goto(`${url}/?payload=${encodeURIComponent(opened)}`);
  const wrong = await page.waitForSelector(".squiggly-error");
  const {x, y, width} = await wrong.boundingBox();
  await page.mouse.click(x + width / 2, y + 8);
  let list = null;
  for (let tries = 0; !list && tries < 10; tries++) {  // the server may not have answered yet
    await pressed("Control", ".");
    list = await page.waitForSelector(".action-widget", {timeout: 3000}).catch(() => null);
  }
  told("fix", await page.$eval(".action-widget", each => each.innerText));
  await page.keyboard.press("Enter");
  await has("PatrolWaypoint");
  await until(() => !document.querySelector(".squiggly-error"));
  told("fixed", await lines());
  await pressed("Control", "Shift", "i");
  await has("{ SeekCharger PatrolWaypoint }");
  told("formatted", await lines());
  await pressed("Control", "End");
  await page.keyboard.type("See");
  await page.waitForSelector(".suggest-widget.visible .monaco-list-row");
  told("completion", await page.$eval(".suggest-widget .monaco-list-row", each => each.innerText));
} finally {
  await page.screenshot({path: "code_server.png"});
  await browser.close();
}
