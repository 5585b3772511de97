/**
 * Runs the command once, in a worker: arguments, files, standard output and exit code are those of a shell. The files
 * that a person chose are read in pieces, and written ones stay in memory.
 */
import {
  ConsoleStdout, Directory, Fd, File as Written, Inode, OpenFile, PreopenDirectory, WASI, wasi,
} from "@bjorn3/browser_wasi_shim";
import type { Outcome, Progress, Run } from "./run";

const PIECE = 1 << 20;
const ABORTED = 134;
const reader = new FileReaderSync();
let read = 0;
let reported = 0;

function count(bytes: number): void {
  read += bytes;
  const now = performance.now();
  if (now - reported < 100) return;
  reported = now;
  postMessage({ read } satisfies Progress);
}

/** A file of the computer, which nothing can change. */
class Chosen extends Inode {
  constructor(readonly file: File) {
    super();
  }

  override path_open(flags: number): { ret: number; fd_obj: Fd | null } {
    if (flags & wasi.OFLAGS_TRUNC) return { ret: wasi.ERRNO_ROFS, fd_obj: null };
    return { ret: wasi.ERRNO_SUCCESS, fd_obj: new OpenChosen(this) };
  }

  override stat(): wasi.Filestat {
    return new wasi.Filestat(this.ino, wasi.FILETYPE_REGULAR_FILE, BigInt(this.file.size));
  }
}

class OpenChosen extends Fd {
  private at = 0;
  private piece = new Uint8Array();
  private start = 0;

  constructor(private readonly chosen: Chosen) {
    super();
  }

  override fd_pread(size: number, offset: bigint): { ret: number; data: Uint8Array } {
    const from = Number(offset);
    if (from < this.start || from >= this.start + this.piece.length) {
      const slice = this.chosen.file.slice(from, from + PIECE);
      try {
        this.piece = new Uint8Array(reader.readAsArrayBuffer(slice));
      } catch {
        return { ret: wasi.ERRNO_IO, data: new Uint8Array() };
      }
      this.start = from;
      count(this.piece.length);
    }
    return { ret: wasi.ERRNO_SUCCESS, data: this.piece.subarray(from - this.start, from - this.start + size) };
  }

  override fd_read(size: number): { ret: number; data: Uint8Array } {
    const part = this.fd_pread(size, BigInt(this.at));
    this.at += part.data.length;
    return part;
  }

  override fd_seek(offset: bigint, whence: number): { ret: number; offset: bigint } {
    const base = whence === wasi.WHENCE_SET ? 0 : whence === wasi.WHENCE_CUR ? this.at : this.chosen.file.size;
    const to = base + Number(offset);
    if (to < 0) return { ret: wasi.ERRNO_INVAL, offset: 0n };
    this.at = to;
    return { ret: wasi.ERRNO_SUCCESS, offset: BigInt(to) };
  }

  override fd_tell(): { ret: number; offset: bigint } {
    return { ret: wasi.ERRNO_SUCCESS, offset: BigInt(this.at) };
  }

  override fd_filestat_get(): { ret: number; filestat: wasi.Filestat } {
    return { ret: wasi.ERRNO_SUCCESS, filestat: this.chosen.stat() };
  }

  override fd_fdstat_get(): { ret: number; fdstat: wasi.Fdstat } {
    return { ret: wasi.ERRNO_SUCCESS, fdstat: new wasi.Fdstat(wasi.FILETYPE_REGULAR_FILE, 0) };
  }
}

/** The shim's own copies the whole file for each write: this one has room for as much again. */
OpenFile.prototype.fd_write = function (this: OpenFile, data: Uint8Array): { ret: number; nwritten: number } {
  const at = Number(this.file_pos);
  const size = Math.max(this.file.data.length, at + data.length);
  const old = this.file.data;
  if (size > old.buffer.byteLength) this.file.data = new Uint8Array(Math.max(size, 2 * old.length, 1 << 16));
  else this.file.data = new Uint8Array(old.buffer);
  if (this.file.data.buffer !== old.buffer) this.file.data.set(old);
  this.file.data = this.file.data.subarray(0, size);
  this.file.data.set(data, at);
  this.file_pos += BigInt(data.length);
  return { ret: wasi.ERRNO_SUCCESS, nwritten: data.length };
};

async function run({ module, args, files }: Run): Promise<Outcome> {
  const folder = new Map<string, Inode>();
  for (const [name, file] of files) folder.set(name, new Chosen(file));
  const output = new OpenFile(new Written([]));
  const errors = new OpenFile(new Written([]));
  const console = (to: OpenFile): Fd => new ConsoleStdout((data) => to.fd_write(data));
  const all = ["isotherm", ...args];
  const shell = new WASI(all, [], [
    new OpenFile(new Written([])), console(output), console(errors), new PreopenDirectory(".", folder),
  ], { debug: false });
  // The shim counts UTF-16 units where the command wants bytes.
  shell.wasiImport["args_sizes_get"] = (count: number, size: number): number => {
    const memory = new DataView(shell.inst.exports.memory.buffer);
    memory.setUint32(count, all.length, true);
    memory.setUint32(size, new TextEncoder().encode(`${all.join("\0")}\0`).length, true);
    return wasi.ERRNO_SUCCESS;
  };
  const instance = await WebAssembly.instantiate(module, {
    wasi_snapshot_preview1: shell.wasiImport as WebAssembly.ModuleImports,
  });
  const exports = instance.exports as { memory: WebAssembly.Memory; _start: () => unknown };
  let code: number;
  let words = "";
  try {
    code = shell.start({ exports });
  } catch (error) {
    code = ABORTED;
    words = `isotherm: ended: ${String(error)}\n`;
  }
  return {
    code,
    stdout: output.file.data.slice(),
    stderr: new TextDecoder().decode(errors.file.data) + words,
    files: written("", folder),
    memory: exports.memory.buffer.byteLength,
  };
}

function written(path: string, folder: ReadonlyMap<string, Inode>): Map<string, Uint8Array<ArrayBuffer>> {
  const found = new Map<string, Uint8Array<ArrayBuffer>>();
  for (const [name, inode] of folder) {
    if (inode instanceof Written) found.set(path + name, inode.data.slice());
    if (inode instanceof Directory) for (const [inner, data] of written(`${path}${name}/`, inode.contents)) found.set(inner, data);
  }
  return found;
}

onmessage = async (event: MessageEvent<Run>): Promise<void> => {
  const outcome = await run(event.data);
  postMessage(outcome, { transfer: [outcome.stdout.buffer, ...[...outcome.files.values()].map((data) => data.buffer)] });
};
