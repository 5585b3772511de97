/**
 * Runs the command once, in a worker: arguments, files, standard output and exit code are those of a shell. The files
 * that a person chose are read in pieces, and written ones stay in memory.
 */
import { ConsoleStdout, Directory, Fd, File as Written, Inode, OpenFile, PreopenDirectory, WASI, wasi,
} from "@bjorn3/browser_wasi_shim";

/** What the page and its worker say to each other. */
export interface Run {
  readonly module: WebAssembly.Module;
  readonly args: readonly string[];
  readonly files: ReadonlyMap<string, File>;
}

export type Progress = { readonly read: number };

export interface Outcome {
  readonly code: number;
  readonly stdout: Uint8Array<ArrayBuffer>;
  readonly stderr: string;
  readonly files: ReadonlyMap<string, Uint8Array<ArrayBuffer>>;
  /** Bytes of memory that the command had at its end. */
  readonly memory: number;
}

/** Bytes of the first piece behind a place, and of the largest: pieces that follow one another double. */
const [LEAST, MOST] = [1 << 16, 1 << 22];
/** The exit code of a program that panicked. */
const PANIC = 101;
const reader = new FileReaderSync();
let read = 0;

/** A file of the computer, which nothing can change. */
class Chosen extends Written {
  constructor(readonly chosen: File) {
    super([], { readonly: true });
  }

  override get size(): bigint {
    return BigInt(this.chosen.size);
  }

  override path_open(...how: Parameters<Written["path_open"]>): ReturnType<Written["path_open"]> {
    const opened = super.path_open(...how);
    return opened.ret === wasi.ERRNO_SUCCESS ? { ...opened, fd_obj: new OpenChosen(this) } : opened;
  }
}

class OpenChosen extends OpenFile {
  private piece = new Uint8Array();
  private start = 0;
  private ahead = LEAST;

  constructor(override readonly file: Chosen) {
    super(file);
  }

  override fd_pread(size: number, offset: bigint): { ret: number; data: Uint8Array } {
    const from = Number(offset);
    if (from < this.start || from >= this.start + this.piece.length) {
      this.ahead = from === this.start + this.piece.length ? Math.min(2 * this.ahead, MOST) : LEAST;
      try {
        this.piece = new Uint8Array(reader.readAsArrayBuffer(this.file.chosen.slice(from, from + this.ahead)));
      } catch {
        return { ret: wasi.ERRNO_IO, data: new Uint8Array() };
      }
      this.start = from;
      read += this.piece.length;
      postMessage({ read } satisfies Progress);
    }
    return { ret: wasi.ERRNO_SUCCESS, data: this.piece.subarray(from - this.start, from - this.start + size) };
  }

  override fd_read(size: number): { ret: number; data: Uint8Array } {
    const part = this.fd_pread(size, this.file_pos);
    this.file_pos += BigInt(part.data.length);
    return part;
  }

  override fd_seek(offset: bigint, whence: number): { ret: number; offset: bigint } {
    if (whence !== wasi.WHENCE_END) return super.fd_seek(offset, whence);
    return super.fd_seek(this.file.size + offset, wasi.WHENCE_SET);
  }
}

/** The shim's own copies the whole file for each write: this one makes room for as much again. */
OpenFile.prototype.fd_write = function (this: OpenFile, data: Uint8Array): { ret: number; nwritten: number } {
  const at = Number(this.file_pos);
  const old = this.file.data;
  const size = Math.max(old.length, at + data.length);
  let room = new Uint8Array(old.buffer);
  if (size > room.length) {
    room = new Uint8Array(Math.max(size, 2 * old.length, 1 << 16));
    room.set(old);
  }
  this.file.data = room.subarray(0, size);
  this.file.data.set(data, at);
  this.file_pos += BigInt(data.length);
  return { ret: wasi.ERRNO_SUCCESS, nwritten: data.length };
};

async function run({ module, args, files }: Run): Promise<Outcome> {
  const folder = new Map<string, Inode>([...files].map(([name, file]) => [name, new Chosen(file)]));
  const [output, errors] = [new OpenFile(new Written([])), new OpenFile(new Written([]))];
  const terminal = (to: OpenFile): Fd => new ConsoleStdout((data) => to.fd_write(data));
  const descriptors = [new OpenFile(new Written([])), terminal(output), terminal(errors), new PreopenDirectory("/", folder)];
  const all = ["isotherm", ...args];
  const shell = new WASI(all, [], descriptors, { debug: false });
  // The shim counts UTF-16 units where the command wants bytes.
  shell.wasiImport["args_sizes_get"] = (count: number, size: number): number => {
    const memory = new DataView(shell.inst.exports.memory.buffer);
    memory.setUint32(count, all.length, true);
    memory.setUint32(size, new TextEncoder().encode(`${all.join("\0")}\0`).length, true);
    return wasi.ERRNO_SUCCESS;
  };
  const imports = { wasi_snapshot_preview1: shell.wasiImport as WebAssembly.ModuleImports };
  const exports = (await WebAssembly.instantiate(module, imports)).exports as Parameters<WASI["start"]>[0]["exports"];
  let code = PANIC;
  let words = "";
  try {
    code = shell.start({ exports });
  } catch (error) {
    words = `isotherm: ${String(error)}\n`;
  }
  return {
    code, stdout: output.file.data.slice(), stderr: new TextDecoder().decode(errors.file.data) + words,
    files: written("", folder), memory: exports.memory.buffer.byteLength,
  };
}

function written(path: string, folder: ReadonlyMap<string, Inode>): Map<string, Uint8Array<ArrayBuffer>> {
  return new Map([...folder].flatMap(([name, inode]): [string, Uint8Array<ArrayBuffer>][] => {
    if (inode instanceof Directory) return [...written(`${path}${name}/`, inode.contents)];
    return inode instanceof Written && !(inode instanceof Chosen) ? [[path + name, inode.data.slice()]] : [];
  }));
}

onmessage = async (event: MessageEvent<Run>): Promise<void> => postMessage(await run(event.data));
