// The page in a browser, for the test and the bench.
import { createRequire } from "node:module";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";

const { chromium } = createRequire(join(process.env.NODE_PATH, "."))("playwright-core");

export async function launch(executablePath, args = []) {
  return chromium.launch({ executablePath, args: ["--no-sandbox", ...args], timeout: 60_000 });
}

/** The page, opened from the disk. `events` has all that it asked of a network, and all that it printed. */
export class IsothermPage {
  static async open(browser, file, { scheme = "light", width = 1200, language = "en-US", query = "" } = {}) {
    const context = await browser.newContext({ colorScheme: scheme, viewport: { width, height: 900 }, locale: language });
    const page = await context.newPage();
    page.setDefaultTimeout(120_000);
    const opened = new IsothermPage(page, pathToFileURL(resolve(file)).href);
    page.on("console", (message) => opened.events.push(`console: ${message.text()}`));
    page.on("pageerror", (error) => opened.events.push(`error: ${error.stack}`));
    page.on("request", (request) => {
      if (!/^(blob|data|about):/.test(request.url()) && request.url() !== opened.url + query) opened.events.push(`request: ${request.url()}`);
    });
    await page.goto(opened.url + query);
    await page.waitForSelector("html[data-ready]");
    return opened;
  }

  constructor(page, url) {
    this.page = page;
    this.url = url;
    this.events = [];
  }

  /** Gives the page files: paths, or `{ name, mimeType, buffer }`. */
  async choose(files) {
    await this.page.setInputFiles("#files", []);
    await this.page.setInputFiles("#files", files);
    await this.looked();
  }

  async looked() {
    await this.page.waitForFunction(() => document.querySelector("#running").hidden && !document.querySelector("#job-section").hidden);
  }

  /** Fills the form of a job; `fields` by long option, `choices` by name. Returns the command line. */
  async prepare(job, fields = {}, choices = undefined) {
    const { page } = this;
    await page.check(`[name=job][value="${job}"]`);
    await page.locator("#job-form details").evaluate((details) => (details.open = true));
    for (const [name, value] of Object.entries(fields)) {
      const field = page.locator(`#option-${name}`);
      const kind = await field.evaluate((it) => (it.type === "checkbox" ? "checkbox" : it.localName));
      if (kind === "checkbox") await field.check();
      else if (kind === "select") await field.selectOption(value);
      else await field.fill(value);
    }
    for (const box of choices ? await page.locator("[name=choice]").all() : []) await box.setChecked(choices.includes(await box.getAttribute("value")));
    return (await page.textContent("#command")).trim();
  }

  /** Runs the job that the form has. */
  async run() {
    await this.page.evaluate(() => document.querySelector("#outcome").replaceChildren());
    await this.page.click("#run");
    return this.outcome();
  }

  /** The result or the refusal, with its outputs. */
  async outcome() {
    const section = this.page.locator("#result, #refusal");
    await section.waitFor();
    const [kind, data] = await section.evaluate((it) => [it.id, { ...it.dataset }]);
    const outputs = new Map();
    for (const link of kind === "result" ? await section.locator("[data-output]").all() : []) {
      const [download] = await Promise.all([this.page.waitForEvent("download"), link.click()]);
      outputs.set(await link.getAttribute("data-output"), await download.path());
    }
    return { kind, ...data, code: Number(data.code), words: await this.page.textContent("#words"), printed: kind === "result" ? await this.page.textContent("#printed") : "", outputs };
  }

  async close() {
    await this.page.context().close();
  }
}
