// Puts the page into one file: styles, scripts, the engine, its options, the example, and licences.
import { createHash } from "node:crypto";
import { mkdtempSync, openSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { WASI } from "node:wasi";
import { gzipSync } from "node:zlib";

const [engine, crates, page] = process.argv.slice(2);
const here = import.meta.dirname;
const modules = process.env.NODE_PATH;
const esbuild = createRequire(join(modules, "."))("esbuild");
const LIMIT = 8e6;

function read(...parts) {
  return readFileSync(join(here, ...parts), "utf8");
}

function script(name) {
  const made = esbuild.buildSync({
    entryPoints: [join(here, "src", name)], nodePaths: [modules], bundle: true, minify: true, write: false,
    format: "iife", target: "es2022", charset: "utf8", legalComments: "none",
  });
  return made.outputFiles[0].text.trim().replaceAll("</script", "<\\/script").replaceAll("<!--", "<\\!--");
}

/** What the engine prints. */
async function printed(...args) {
  const folder = mkdtempSync(join(tmpdir(), "isotherm-page-"));
  try {
    const stdout = openSync(join(folder, "stdout"), "w");
    const wasi = new WASI({ version: "preview1", args: ["isotherm", ...args], stdout, returnOnExit: true });
    const { instance } = await WebAssembly.instantiate(readFileSync(engine), wasi.getImportObject());
    const code = wasi.start(instance);
    if (code !== 0) throw new Error(`${args.join(" ")} ended with ${code}`);
    return readFileSync(join(folder, "stdout"), "utf8").trim();
  } finally {
    rmSync(folder, { recursive: true });
  }
}

const scripts = script("page.ts");
const policy = [
  "default-src 'none'", `script-src 'sha256-${createHash("sha256").update(scripts).digest("base64")}' 'wasm-unsafe-eval'`,
  "worker-src blob:", "style-src 'unsafe-inline'", "img-src data: blob:", "base-uri 'none'", "form-action 'none'",
];
const licences = [
  "Isotherm: MIT OR Apache-2.0.", "", "The example is a recording of tofupilot/examples:", "",
  read("../../calibration/fit/tests/data/consumer/LICENSE"),
  "@bjorn3/browser_wasi_shim:", "", readFileSync(join(modules, "@bjorn3/browser_wasi_shim/LICENSE-MIT"), "utf8"),
  readFileSync(crates, "utf8"),
].join("\n");
const packed = (data) => gzipSync(data, { level: 9 }).toString("base64");
const parts = {
  POLICY: policy.join("; "),
  STYLE: esbuild.transformSync(read("src/page.css"), { loader: "css", minify: true }).code.trim(),
  LICENCES: packed(licences),
  ENGINE: packed(readFileSync(engine)),
  EXAMPLE: readFileSync(join(here, "data/warm-up.ulg.gz")).toString("base64"),
  WORKER: script("worker.ts"),
  OPTIONS: (await printed("arguments")).replaceAll("<", "\\u003c"),
  SCRIPT: scripts,
};
const html = read("src/page.html").replace(new RegExp(Object.keys(parts).join("|"), "g"), (name) => parts[name]);
writeFileSync(page, html);
const size = Buffer.byteLength(html);
if (size > LIMIT) throw new Error(`${page} has ${size} bytes: at most ${LIMIT} are allowed`);
console.log(`${page}: ${(size / 1e6).toFixed(2)} MB`);
