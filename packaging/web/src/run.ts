/** What the page and its worker say to each other: one run of the command is one worker. */
export interface Run {
  readonly module: WebAssembly.Module;
  readonly args: readonly string[];
  readonly files: ReadonlyMap<string, File>;
}

export interface Progress {
  readonly read: number;
}

export interface Outcome {
  readonly code: number;
  readonly stdout: Uint8Array<ArrayBuffer>;
  readonly stderr: string;
  readonly files: ReadonlyMap<string, Uint8Array<ArrayBuffer>>;
  /** Bytes of memory that the command had at its end. */
  readonly memory: number;
}
