// See `test`.
import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { copyFileSync, mkdtempSync, readFileSync, readdirSync, rmSync, truncateSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { basename, join } from "node:path";
import { gunzipSync } from "node:zlib";
import { IsothermPage, launch } from "./browser.mjs";

const [html, isotherm, chromium] = process.argv.slice(2);
const axe = readFileSync(createRequire(join(process.env.NODE_PATH, ".")).resolve("axe-core/axe.min.js"), "utf8");
const scratch = mkdtempSync(join(tmpdir(), "isotherm-page-"));
const browser = await launch(chromium);
const failures = [];
let passed = 0;

async function test(name, body) {
  try {
    await body();
    passed += 1;
    console.log(`ok      ${name}`);
  } catch (error) {
    failures.push(name);
    console.log(`FAILED  ${name}\n${error.stack.slice(0, 3000)}`);
  }
}

function made(name, content) {
  const path = join(scratch, name);
  writeFileSync(path, content);
  return path;
}

/** Without what differs from run to run: the time of it. */
function timeless(bytes) {
  return bytes.toString("latin1").replace(/\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?Z/g, "TIME");
}

/** Runs the command line that the page shows, in a folder with the same files. */
function native(line, files) {
  const folder = mkdtempSync(join(scratch, "native-"));
  for (const file of files) copyFileSync(file, join(folder, basename(file)));
  const before = new Set(readdirSync(folder));
  const script = `isotherm() { ${JSON.stringify(isotherm)} "$@"; }; ${line}`;
  const { status, stdout, stderr } = spawnSync("bash", ["-c", script], { cwd: folder, maxBuffer: 1 << 30 });
  const outputs = new Map(readdirSync(folder).filter((name) => !before.has(name)).map((name) => [name, readFileSync(join(folder, name))]));
  return { status, stdout, stderr: stderr.toString(), outputs };
}

/** A job in the page gives what its command line gives: exit code, words, every output. */
async function equal(page, { files, job, fields, choices, code = 0 }) {
  await page.choose(files);
  const line = await page.prepare(job, fields, choices);
  const here = await page.run();
  const there = native(line, files);
  assert.equal(here.code, there.status, `${line}\n${here.words}\n${there.stderr}`);
  assert.equal(here.code, code, `${line}\n${here.words}`);
  assert.equal(timeless(Buffer.from(here.words)), timeless(Buffer.from(there.stderr)), line);
  if (here.kind === "refusal") return assert.equal(there.outputs.size, 0, line);
  const outputs = new Map([...here.outputs].map(([name, path]) => [name, readFileSync(path)]));
  if (line.includes("--json")) there.outputs.set([...outputs.keys()].find((name) => name.endsWith(".json")), there.stdout);
  else assert.equal(timeless(Buffer.from(here.printed)), timeless(there.stdout), line);
  assert.deepEqual([...outputs.keys()].sort(), [...there.outputs.keys()].sort(), line);
  for (const [name, data] of outputs) assert.ok(timeless(data) === timeless(there.outputs.get(name)), `${line}: ${name} differs\n${difference(data, there.outputs.get(name))}`);
  const digests = [...outputs].filter(([name]) => name.endsWith(".toml")).map(([, data]) => /^digest = "(.*)"/m.exec(data.toString())[1]);
  assert.equal(here.digest, digests.join(" "));
}

function difference(one, other) {
  const [left, right] = [timeless(one).split("\n"), timeless(other).split("\n")];
  const n = left.findIndex((line, at) => line !== right[at]);
  const at = [...(left[n] ?? "")].findIndex((letter, k) => letter !== (right[n] ?? "")[k]);
  return `line ${n + 1}, column ${at + 1}:\n  page   ${left[n]?.slice(Math.max(0, at - 60), at + 100)}\n  native ${right[n]?.slice(Math.max(0, at - 60), at + 100)}`;
}

const logs = "recording/formats/tests/data/autopilots";
const fit = "calibration/fit/tests/data";
const lab = `${fit}/any_lab`;
const nominal = `${fit}/consumer/nominal.toml`;
const example = made("warm-up.ulg", gunzipSync(readFileSync("packaging/web/data/warm-up.ulg.gz")));
const night = join(scratch, "night");
const simulated = spawnSync(isotherm, ["simulate", "run", "-o", night, "--temperatures", "20,21", "--ramp", "1", "--hold", "1", "--sensor-noise", "40", "--seed", "3"]);
assert.equal(simulated.status, 0, simulated.stderr?.toString());
const tumble = { "gravity-local": "9.79179" };
const mapping = "recording/formats/tests/data/convert/mapping.toml";
const source = "recording/formats/tests/data/convert/source.csv";

const cases = {
  "warm-up of a ULog, for PX4": { files: [`${logs}/heating.ulg`], job: "warm-up", choices: ["px4"] },
  "warm-up of DataFlash, for ArduPilot": { files: [`${logs}/heating.BIN`], job: "warm-up", choices: ["ardupilot"] },
  "warm-up of the example, for both": { files: [example], job: "warm-up", choices: ["px4", "ardupilot"], fields: { imu: "my-drone" } },
  "warm-up with a lag": { files: [example], job: "warm-up", choices: [], fields: { lag: "100", order: "3" } },
  "warm-up of a recording with its nominal table": { files: [`${fit}/consumer/thermal-run.csv`, nominal], job: "warm-up", choices: [] },
  "a tumble": { files: [`${lab}/tumble3/recording.csv`], job: "tumble", fields: tumble },
  "a tumble of a real IMU": { files: [`${lab}/xsens/recording.csv`], job: "tumble", fields: { ...tumble, order: "0", "temperature-range": "15,35" } },
  "noise": { files: [join(night, "run.csv"), join(night, "truth.toml")], job: "noise", choices: ["kalibr"] },
  "verify": { files: [`${fit}/consumer/thermal-run.csv`, nominal], job: "verify" },
  "compare": { files: [`${lab}/compare/2025.toml`, `${lab}/compare/2026.toml`], job: "compare", fields: { require: "bias=1ug0" }, code: 1 },
  "compare four": { files: [2023, 2024, 2025, 2026].map((year) => `${lab}/compare/${year}.toml`), job: "compare" },
  "convert a text": { files: [source, mapping], job: "convert", choices: [] },
  "convert a ULog to MCAP": { files: [`${logs}/heating.ulg`], job: "convert", fields: { output: "run.mcap" }, choices: [] },
  "convert DataFlash": { files: [`${logs}/heating.BIN`], job: "convert", choices: [] },
  "parameters of PX4 to a table": { files: [`${fit}/autopilots/heating.params`], job: "import" },
  "parameters of ArduPilot to a table": { files: [`${fit}/autopilots/full.parm`], job: "import", fields: { from: "ardupilot" } },
  "a refusal: no attitudes": { files: [`${logs}/heating.ulg`], job: "tumble", fields: tumble, code: 65 },
  "a refusal: a text without a mapping": { files: [source], job: "convert", code: 64 },
  "a refusal: an option that is none": { files: [`${logs}/heating.ulg`], job: "warm-up", fields: { order: "9" }, code: 64 },
  "a refusal: an empty file": { files: [made("empty.ulg", "")], job: "warm-up", code: 65 },
  "a refusal: damage": { files: [made("damaged.ulg", readFileSync(`${logs}/heating.ulg`).map((byte, n) => (n > 40 ? byte ^ (n * 37) : byte)))], job: "warm-up", code: 65 },
  "names with blanks, quotation marks and hyphens": { files: [made("-a 'b' \u6e29\u5ea6.ulg", readFileSync(`${logs}/heating.ulg`))], job: "warm-up", choices: [] },
};

const page = await IsothermPage.open(browser, html);
for (const [name, one] of Object.entries(cases)) await test(`equal: ${name}`, () => equal(page, one));

await test("a text gets its mapping", async () => {
  await page.choose([source]);
  const link = page.page.locator(".card [data-output]");
  const [download] = await Promise.all([page.page.waitForEvent("download"), link.click()]);
  const open = readFileSync(await download.path(), "utf8");
  const proposed = made("mapping.toml", open.replaceAll('kind = "?"', 'kind = "reading"').replaceAll('offset = "?"', "offset = 32768"));
  await page.page.setInputFiles("#files", proposed);
  await page.looked();
  assert.equal(await page.page.locator(".card").count(), 2);
  assert.match(await page.prepare("convert"), /^isotherm convert source\.csv .*--mapping mapping\.toml/);
  assert.equal((await page.run()).kind, "result");
});

await test("a table of the page becomes parameters", async () => {
  await page.choose([`${logs}/heating.ulg`]);
  await page.prepare("warm-up", { imu: "a" }, []);
  const { outputs } = await page.run();
  const table = made("a.toml", readFileSync(outputs.get("a.toml")));
  await equal(page, { files: [table], job: "export", fields: { to: "px4", drop: "lag" } });
});

await test("every shipped log is described as the command does it", async () => {
  const texts = ["tumble3", "xsens", "ferraris"].map((name) => `${lab}/${name}/recording.csv`);
  const bags = ["old.mcap", "bags/zstd.mcap", "bags/lz4.mcap"].map((name) => `recording/formats/tests/data/${name}`);
  for (const file of [...["heating.ulg", "heating.BIN"].map((name) => `${logs}/${name}`), ...texts, ...bags, example, `${fit}/consumer/thermal-run.csv`, `${fit}/ramp/ramp-1.csv`, "tests/data/run.csv", "tests/data/run-g.csv"]) {
    await page.choose([file]);
    const there = JSON.parse(native(`isotherm describe ${basename(file)} --json`, [file]).stdout).files[0];
    assert.equal(await page.page.locator(".card").count(), 1, file);
    assert.match(await page.page.textContent(".card h3"), new RegExp(there.format.replace(/[^\w ]/g, ".")), file);
    const findings = await page.page.locator(".card .findings li strong").allTextContents();
    assert.deepEqual(findings.map((text) => text.trim()), there.findings.map((one) => `${one.severity} [${one.name}]`), file);
    const rows = there.imus.map((imu) => imu.rows).filter((count) => count !== null);
    const shown = (await page.page.locator(".card dd").allTextContents()).map((text) => text.replaceAll("\u202f", ""));
    for (const count of rows) assert.ok(shown.includes(String(count)), `${file}: ${shown}`);
  }
});

await test("the example is one button, and the query presets the fields", async () => {
  const preset = await IsothermPage.open(browser, html, { query: "?job=warm-up&imu=a&order=2" });
  await preset.page.click("#example");
  await preset.looked();
  const line = (await preset.page.textContent("#command")).trim();
  assert.match(line, /^isotherm calibrate warm-up warm-up\.ulg --imu a .*--order 2/);
  const { kind, job, digest } = await preset.run();
  assert.deepEqual([kind, job], ["result", "warm-up"]);
  assert.match(digest, /^sha256:[0-9a-f]{64}$/);
  assert.deepEqual(preset.events, []);
  await preset.close();
});

await test("the page has the licences of what is in it", async () => {
  await page.page.click("#about summary");
  await page.page.waitForFunction(() => document.querySelector("#licences").textContent !== "");
  const licences = await page.page.textContent("#licences");
  for (const name of ["tofupilot", "@bjorn3/browser_wasi_shim", "nalgebra", "mcap", "libm"]) assert.ok(licences.includes(name), name);
  await page.page.click("#about summary");
});

await test("hostile names and texts stay texts", async () => {
  const attack = `<img src=x onerror="globalThis.hacked=1;parent.hacked=1"><script>globalThis.hacked=1<\u200b`.replaceAll("/", "");
  const files = [made(`${attack}.ulg`, readFileSync(`${logs}/heating.ulg`))];
  await equal(page, { files, job: "warm-up", fields: { imu: "a" }, choices: [] });
  const frame = await (await page.page.locator("iframe").elementHandle()).contentFrame();
  assert.ok((await frame.content()).includes("&lt;img src=x"), "the report does not name the file");
  const table = readFileSync(`${lab}/compare/2025.toml`, "utf8").replace("imu-a", `<script>hacked=1</script>`);
  await page.choose([made("hostile.toml", table), made("names.csv", `time,${attack},<b>bold</b>\n1,2,3\n`), made("log.ulg", `ULog<script>hacked=1</script>`), made("vehicle.params", `# <script>hacked=1</script>\n1\t1\t<img src=x onerror=hacked=1>\t1\t9\n`)]);
  for (const job of ["warm-up", "convert", "compare", "import", "export"]) {
    await page.prepare(job);
    await page.run();
  }
  for (const frame of page.page.frames()) {
    assert.equal(await frame.evaluate(() => globalThis.hacked), undefined);
    assert.equal(await frame.locator("img").count(), 0);
  }
});

await test("a huge file is stopped, and the next job works", async () => {
  const huge = made("huge.ulg", readFileSync(`${logs}/heating.ulg`));
  truncateSync(huge, 6e9);
  await page.page.setInputFiles("#files", huge);
  await page.page.waitForFunction(() => document.querySelector("#read").textContent !== "");
  await page.page.click("#stop");
  await page.looked();
  assert.equal(await page.page.textContent("#status"), "The command was stopped. Nothing was written.");
  await page.prepare("warm-up");
  await page.page.click("#run");
  await page.page.waitForFunction(() => document.querySelector("#read").textContent !== "");
  await page.page.click("#stop");
  await page.page.waitForFunction(() => document.querySelector("#running").hidden);
  assert.equal(await page.page.locator("#result, #refusal").count(), 0);
  rmSync(huge);
  await equal(page, cases["warm-up of a ULog, for PX4"]);
});

await test("the corpora of the fuzzers leave the page alive", async () => {
  for (const corpus of ["formats", "convert"]) {
    for (const name of readdirSync(`tests/fuzz/corpus/${corpus}`)) {
      await page.choose([`tests/fuzz/corpus/${corpus}/${name}`]);
      await page.prepare("convert", { output: "run.csv" });
      const { code, words } = await page.run();
      assert.notEqual(code, 101, `${corpus}/${name}: ${words}`);
    }
  }
  await equal(page, cases["a tumble"]);
});

await test("nothing was printed, and nothing was asked of a network", () => assert.deepEqual(page.events, []));

for (const scheme of ["light", "dark"]) {
  for (const width of [1200, 375]) {
    for (const language of ["en-US", "zh-CN"]) {
      await test(`accessible: ${scheme}, ${width} px, ${language}`, async () => {
        const one = await IsothermPage.open(browser, html, { scheme, width, language });
        const check = async (state) => {
          await one.page.evaluate(axe);
          const { violations } = await one.page.evaluate(() => globalThis.axe.run(document, { iframes: false }));
          assert.deepEqual(violations.map(({ id, nodes }) => `${state}: ${id}: ${nodes.map((node) => node.html).join(" | ")}`), []);
          assert.ok(await one.page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), `${state}: wider than the window`);
        };
        await check("at first");
        await one.page.click("#example");
        await one.looked();
        await one.prepare("warm-up");
        await check("with a form");
        assert.equal((await one.run()).kind, "result");
        await one.page.locator("details").evaluateAll((all) => all.forEach((details) => (details.open = true)));
        await check("with a result");
        await one.prepare("tumble", tumble);
        assert.equal((await one.run()).kind, "refusal");
        await check("with a refusal");
        assert.deepEqual(one.events, []);
        await one.close();
      });
    }
  }
}

await browser.close();
rmSync(scratch, { recursive: true });
console.log(`${passed} passed, ${failures.length} failed`);
process.exitCode = failures.length ? 1 : 0;
