// See `bench`.
import { spawnSync } from "node:child_process";
import { closeSync, mkdtempSync, openSync, readFileSync, readdirSync, rmSync, statSync, writeSync } from "node:fs";
import { tmpdir } from "node:os";
import { basename, dirname, join } from "node:path";
import { gunzipSync } from "node:zlib";
import { IsothermPage, launch } from "./browser.mjs";

const [html, isotherm, chromium] = process.argv.slice(2);
const scratch = mkdtempSync(join(process.env.TMPDIR ?? tmpdir(), "isotherm-page-"));
const LOADS = 10;

/** The example again and again, with times that go on, until it has so many bytes. */
function long_ulog(name, bytes) {
  const log = gunzipSync(readFileSync("packaging/web/data/warm-up.ulg.gz"));
  const path = join(scratch, name);
  const file = openSync(path, "w");
  let begin = 16;
  const messages = [];
  for (let at = begin; at + 3 <= log.length; at += 3 + log.readUInt16LE(at)) {
    // Data: the time, and in sensor_accel and sensor_gyro that of the sample behind it.
    if (log[at + 2] === 0x44) messages.push(at + 5, ...(log.readUInt16LE(at + 3) < 2 ? [at + 13] : []));
    else if (messages.length === 0) begin = at + 3 + log.readUInt16LE(at);
  }
  writeSync(file, log.subarray(0, begin));
  const rows = Buffer.from(log.subarray(begin));
  const stamps = messages.map((at) => at - begin).filter((at) => at >= 0 && at + 8 <= rows.length);
  const first = stamps.map((at) => rows.readBigUInt64LE(at));
  const period = first.at(-1) - first[0] + 100_000n;
  for (let n = 0n, size = begin; size < bytes; n += 1n, size += rows.length) {
    stamps.forEach((at, k) => rows.writeBigUInt64LE(first[k] + n * period, at));
    writeSync(file, rows);
  }
  closeSync(file);
  return path;
}

/** The same of a recording in CSV. */
function long_csv(name, bytes) {
  const [head, ...rows] = readFileSync("calibration/fit/tests/data/consumer/thermal-run.csv", "utf8").trim().split("\n");
  const path = join(scratch, name);
  const file = openSync(path, "w");
  writeSync(file, `${head}\n`);
  const cells = rows.map((row) => row.split(","));
  const period = BigInt(cells.at(-1)[1]);
  for (let n = 0n, size = 0; size < bytes; n += 1n) {
    const block = cells.map(([sequence, time, interval, temperature_time, ...rest]) => {
      const later = [BigInt(sequence) + n * BigInt(cells.length), BigInt(time) + n * period, interval, BigInt(temperature_time) + n * period];
      return [...later, ...rest].join(",");
    });
    size += writeSync(file, `${block.join("\n")}\n`);
  }
  closeSync(file);
  return path;
}

/** The largest peak of memory of a renderer, which has the page and its worker [MB]. */
function renderer_peak() {
  const peaks = readdirSync("/proc").filter((name) => /^\d+$/.test(name)).map((pid) => {
    try {
      if (!readFileSync(`/proc/${pid}/cmdline`, "latin1").includes("--type=renderer")) return 0;
      return Number(/VmHWM:\s+(\d+) kB/.exec(readFileSync(`/proc/${pid}/status`, "latin1"))?.[1] ?? 0) / 1e3;
    } catch {
      return 0;
    }
  });
  return Math.max(...peaks);
}

function seconds(body) {
  const begin = performance.now();
  return [body(), () => (performance.now() - begin) / 1e3];
}

async function ready() {
  const times = [];
  for (let n = 0; n < LOADS; n += 1) {
    const browser = await launch(chromium);
    const page = await IsothermPage.open(browser, html);
    times.push(Number(await page.page.getAttribute("html", "data-ready")));
    await browser.close();
  }
  return times.sort((a, b) => a - b)[LOADS / 2];
}

console.log(`size of the page          ${(statSync(html).size / 1e6).toFixed(2)} MB`);
console.log(`ready, median of ${LOADS}       ${await ready()} ms\n`);
console.log("| input | bytes | job | native s | page s | page/native speed | wasm memory MB | renderer peak MB | described in s |");
console.log("|---|---|---|---|---|---|---|---|---|");
const nominal = "calibration/fit/tests/data/consumer/nominal.toml";
for (const [make, name, bytes, job, more] of [
  [long_ulog, "short.ulg", 100e6, "warm-up", []], [long_csv, "short.csv", 100e6, "verify", [nominal]],
  [long_ulog, "long.ulg", 1e9, "warm-up", []], [long_csv, "long.csv", 1e9, "verify", [nominal]],
]) {
  const path = make(name, bytes);
  const browser = await launch(chromium);
  const page = await IsothermPage.open(browser, html);
  page.page.setDefaultTimeout(1_800_000);
  const [looked, described] = seconds(() => page.choose([path, ...more]));
  await looked;
  const look = described();
  const line = await page.prepare(job, {}, []);
  const [running, ran] = seconds(() => page.run());
  const outcome = await running;
  const here = ran();
  const script = `isotherm() { ${JSON.stringify(isotherm)} "$@"; }; ${line}`;
  for (const file of more) spawnSync("cp", [file, dirname(path)]);
  const [native, took] = seconds(() => spawnSync("bash", ["-c", script], { cwd: dirname(path), maxBuffer: 1 << 30 }));
  const there = took();
  if (native.status !== outcome.code) console.log(`${basename(path)}: ${outcome.code} here, ${native.status} there: ${outcome.words}\n${native.stderr}`);
  console.log(`| ${name} | ${statSync(path).size} | ${job} | ${there.toFixed(2)} | ${here.toFixed(2)} | ${(there / here).toFixed(2)} | ${(outcome.memory / 1e6).toFixed(0)} | ${renderer_peak().toFixed(0)} | ${look.toFixed(2)} |`);
  await browser.close();
  rmSync(path);
}
rmSync(scratch, { recursive: true });
