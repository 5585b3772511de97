// Runs the engine with the command line behind its path, in the current folder: node run.mjs ENGINE ARGUMENT..
// The folder is both `.` and `/` of the program, as the page gives it.
import { readFileSync } from 'node:fs';
import { WASI } from 'node:wasi';

const [engine, ...words] = process.argv.slice(2);
const wasi = new WASI({
  version: 'preview1',
  args: ['isotherm', ...words],
  env: {},
  preopens: { '/': process.cwd() },
  returnOnExit: true,
});
const module = new WebAssembly.Module(readFileSync(engine));
// Called by way of JavaScript: the direct calls of node 20 abort it when they have been optimised.
const { wasi_snapshot_preview1: calls } = wasi.getImportObject();
const imports = Object.fromEntries(Object.keys(calls).map((name) => [name, (...words) => calls[name](...words)]));
const instance = new WebAssembly.Instance(module, { wasi_snapshot_preview1: imports });
try {
  process.exitCode = wasi.start(instance);
} catch (error) {
  // What would be a panic in the native program.
  console.error(String(error));
  process.exitCode = 101;
}
if (process.env.ISOTHERM_MEMORY) {
  console.error(`memory: ${instance.exports.memory.buffer.byteLength} bytes`);
}
