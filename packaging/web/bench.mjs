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

/**
 * The example at 1 kHz, slower by as much as it needs to have so many bytes: between two messages of a topic come others
 * on the line through them, with noise as large as their difference.
 */
function long_ulog(name, bytes) {
  const log = gunzipSync(readFileSync("packaging/web/data/warm-up.ulg.gz"));
  const path = join(scratch, name);
  const file = openSync(path, "w");
  const formats = new Map();
  const floats = new Map();
  const slots = [];
  let begin = 16;
  for (let at = begin; at + 3 <= log.length; at += 3 + log.readUInt16LE(at)) {
    const message = log.subarray(at, at + 3 + log.readUInt16LE(at));
    const kind = String.fromCharCode(message[2]);
    if (kind === "F") {
      const [topic, fields] = message.toString("latin1", 3).split(":");
      formats.set(topic, fields);
    } else if (kind === "A") {
      floats.set(message.readUInt16LE(4), floats_of(formats.get(message.toString("latin1", 6))));
    } else if (kind === "D") {
      if (message.readUInt16LE(3) === 0) slots.push([]);
      slots.at(-1)?.push(message);
    }
    if (slots.length === 0) begin = at + message.length;
  }
  writeSync(file, log.subarray(0, begin));
  const copies = Math.ceil((bytes - begin) / (log.length - begin));
  let random = 1;
  const noise = () => (random = (random * 48271) % 2147483647) / 1073741823.5 - 1;
  let now = slots[0][0].readBigUInt64LE(5);
  slots.slice(0, -1).forEach((slot, n) => {
    const parts = [];
    for (let copy = 0; copy < copies; copy += 1, now += 1_000n) {
      for (const from of slot) {
        const topic = from.readUInt16LE(3);
        const to = slots[n + 1].find((message) => message.readUInt16LE(3) === topic) ?? from;
        const message = Buffer.from(from);
        message.writeBigUInt64LE(now, 5);
        if (topic < 2) message.writeBigUInt64LE(now, 13);
        for (const at of floats.get(topic)) {
          const [a, b] = [from.readFloatLE(at), to.readFloatLE(at)];
          message.writeFloatLE(a + (b - a) * (copy / copies + noise()), at);
        }
        parts.push(message);
      }
    }
    writeSync(file, Buffer.concat(parts));
  });
  closeSync(file);
  return path;
}

/** Where the floats of a topic are in its messages. */
function floats_of(fields) {
  const sizes = { uint64_t: 8, uint32_t: 4, int32_t: 4, float: 4, uint16_t: 2, uint8_t: 1, int8_t: 1, bool: 1 };
  let at = 5;
  return fields.split(";").filter(Boolean).flatMap((field) => {
    const [, type, count] = /^(\w+?)(?:\[(\d+)\])? /.exec(field);
    const places = Array.from({ length: Number(count ?? 1) }, (_, k) => at + k * sizes[type]);
    at += places.length * sizes[type];
    return type === "float" ? places : [];
  });
}

/** A recording in CSV, in which each row is parted into as many as it needs to have so many bytes. */
function long_csv(name, bytes) {
  const [head, ...lines] = readFileSync("calibration/fit/tests/data/consumer/thermal-run.csv", "utf8").trim().split("\n");
  const path = join(scratch, name);
  const file = openSync(path, "w");
  writeSync(file, `${head}\n`);
  const is_count = head.split(",").map((column) => /_(positive|negative)$/.test(column));
  const rows = lines.map((line) => line.split(",").map(Number));
  const size = lines.reduce((sum, line) => sum + line.length + 1, 0);
  const copies = Math.ceil(bytes / size);
  let sequence = 0;
  let now = 1_000_000_000;
  rows.forEach((row, n) => {
    const interval = Math.round(row[2] / copies);
    const values = row.slice(4).map((value, k) => (is_count[k + 4] ? Math.round(value / copies) : value));
    const next = rows[n + 1] ?? row;
    let text = "";
    for (let copy = 0; copy < copies; copy += 1, sequence += 1) {
      now += interval;
      const at = (value, k) => (is_count[k + 4] ? value : (value + ((next[k + 4] - value) * copy) / copies).toFixed(4));
      text += `${sequence},${now},${interval},${now},${values.map(at).join(",")}\n`;
    }
    writeSync(file, text);
  });
  closeSync(file);
  return path;
}

/** A recording in CSV, again and again at its own rate of 2 Hz until it has so many bytes: 30 days in 1 GB. */
function repeated_csv(name, bytes) {
  const [head, ...lines] = readFileSync("calibration/fit/tests/data/consumer/thermal-run.csv", "utf8").trim().split("\n");
  const path = join(scratch, name);
  const file = openSync(path, "w");
  writeSync(file, `${head}\n`);
  const rows = lines.map((line) => line.split(","));
  const period = Number(rows.at(-1)[1]);
  for (let n = 0, size = 0; size < bytes; n += 1) {
    const later = ([sequence, time, interval, of_temperature, ...rest]) =>
      [Number(sequence) + n * rows.length, Number(time) + n * period, interval, Number(of_temperature) + n * period, ...rest].join(",");
    size += writeSync(file, `${rows.map(later).join("\n")}\n`);
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
  [repeated_csv, "days.csv", 1e9, "verify", [nominal]],
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
