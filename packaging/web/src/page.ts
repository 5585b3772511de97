/** The page: what was found in the files, a form of each job's options, its command line, and what a run gave. */
import jobs from "./jobs.json";
import type { Outcome, Progress, Run } from "./run";
import words from "./words.json";

interface Option {
  readonly id: string;
  readonly long: string | null;
  readonly value_name: string | null;
  readonly help: string;
  readonly long_help: string | null;
  readonly required: boolean;
  readonly takes_value: boolean;
  readonly positional: boolean;
  readonly default: string | null;
  readonly possible_values: readonly string[];
}
interface Command { readonly name: string; readonly about: string; readonly options: readonly Option[] }
interface Finding { readonly name: string; readonly severity: string; readonly message: string; readonly meaning?: string; readonly remedy?: string }
interface Advice { readonly job: string; readonly good: boolean; readonly reason: string }
interface Found {
  readonly file: string;
  readonly kind: string;
  readonly format: string;
  readonly facts: readonly (readonly [string, string])[];
  readonly imus: number;
  readonly jobs: readonly Advice[];
  readonly findings: readonly Finding[];
  readonly error?: string;
}
interface Job {
  readonly job: string;
  readonly command: readonly string[];
  readonly main: readonly string[];
  readonly defaults: Readonly<Record<string, string>>;
  readonly inputs: Readonly<Record<string, string>>;
  readonly outputs: Readonly<Record<string, string>>;
  readonly choices: Readonly<Record<string, readonly string[]>>;
  readonly sentence: string;
  readonly figures: Readonly<Record<string, readonly string[]>>;
}
type Language = keyof typeof words;
type Word = keyof (typeof words)["en"];
type Json = null | boolean | number | string | readonly Json[] | { readonly [key: string]: Json };

const JOBS: readonly Job[] = jobs as unknown as readonly Job[];
const COMMANDS = JSON.parse(text_of("options")) as { commands: readonly Command[] };
const HIDDEN = new Set(["help", "version", "quiet", "verbose", "domain"]);
const query = new URLSearchParams(location.search);
const files = new Map<string, File>();
let found: readonly Found[] = [];
let language: Language = (query.get("lang") ?? navigator.language).startsWith("zh") ? "zh" : "en";
let job = JOBS.find((one) => one.job === query.get("job"));
let stop = (): void => undefined;

function text_of(id: string): string {
  return element(id).textContent ?? "";
}

function element(id: string): HTMLElement {
  const one = document.getElementById(id);
  if (!one) throw new Error(`the page has no #${id}`);
  return one;
}

function word(name: string): string {
  return words[language][name as Word] ?? name;
}

/** An element with attributes and children. Texts never become markup. */
function h<K extends keyof HTMLElementTagNameMap>(
  tag: K, attributes: Readonly<Record<string, string | boolean>> = {}, ...children: (Node | string)[]
): HTMLElementTagNameMap[K] {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) if (value !== false) made.setAttribute(name, value === true ? "" : value);
  made.append(...children);
  return made;
}

function english(...children: (Node | string)[]): HTMLElement {
  return h("span", { lang: "en" }, ...children);
}

/* Engine */

async function bytes_of(id: string): Promise<Response> {
  const packed = Uint8Array.from(atob(text_of(id).trim()), (letter) => letter.charCodeAt(0));
  element(id).remove();
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream, { headers: { "content-type": "application/wasm" } });
}

const engine = bytes_of("engine").then(async (response) => WebAssembly.compileStreaming(response));
const worker_url = URL.createObjectURL(new Blob([text_of("worker")], { type: "text/javascript" }));

/** Runs the command in a worker of its own. Null: it was stopped. */
async function run(args: readonly string[], on_read?: (bytes: number) => void): Promise<Outcome | null> {
  const module = await engine;
  const worker = new Worker(worker_url);
  try {
    return await new Promise((resolve, reject) => {
      stop = (): void => resolve(null);
      worker.onmessage = ({ data }: MessageEvent<Progress | Outcome>): void => ("code" in data ? resolve(data) : on_read?.(data.read));
      worker.onerror = (event): void => reject(new Error(event.message));
      worker.postMessage({ module, args, files } satisfies Run);
    });
  } finally {
    worker.terminate();
  }
}

function text(data: Uint8Array): string {
  return new TextDecoder().decode(data);
}

/* Files, and what was found in them */

async function take(chosen: Iterable<File>): Promise<void> {
  files.clear();
  for (const file of chosen) {
    let name = file.name;
    for (let n = 2; files.has(name); n += 1) name = file.name.replace(/(\.[^.]*)?$/, ` (${n})$1`);
    files.set(name, file);
  }
  if (files.size === 0) return;
  element("outcome").replaceChildren();
  say("looking");
  const outcome = await run(["describe", ...[...files.keys()].map(argument), "--json"]);
  if (!outcome) return;
  try {
    found = (JSON.parse(text(outcome.stdout)) as { files: readonly Found[] }).files;
  } catch {
    found = [];
    refuse(outcome);
  }
  const good = found.flatMap((one) => one.jobs).find((advice) => advice.good);
  if (!query.has("job")) job = JOBS.find((one) => one.job === good?.job);
  say("");
  draw();
  element("found-heading").scrollIntoView({ block: "nearest" });
}

/** A name as the command takes it: one with a hyphen in front is none of its options. */
function argument(name: string): string {
  return name.startsWith("-") ? `./${name}` : name;
}

function say(name: Word | ""): void {
  element("status").textContent = name && word(name);
}

function card(one: Found): HTMLElement {
  const facts = h("dl", {});
  for (const [name, value] of one.facts) facts.append(h("div", {}, h("dt", {}, word(name)), h("dd", {}, english(value))));
  const list = h("ul", { class: "findings", lang: "en" });
  for (const finding of one.findings) {
    list.append(h("li", { class: finding.severity },
      h("p", {}, h("strong", {}, `${finding.severity} [${finding.name}] `), finding.message),
      h("p", { class: "muted" }, [finding.meaning, finding.remedy].filter(Boolean).join(" "))));
  }
  const good = one.jobs.filter((advice) => advice.good).map((advice) => word(advice.job));
  return h("article", { class: "card", "data-file": one.file },
    h("h3", {}, h("span", { lang: "en" }, one.file), " ", h("span", { class: "tag", lang: "en" }, one.format || one.kind)),
    one.error ? h("p", { class: "bad", lang: "en" }, one.error) : "",
    facts,
    good.length ? h("p", {}, `${word("good_for")} `, good.join(word("comma")), word("stop_mark")) : "",
    one.findings.length ? list : "");
}

/* The form of a job */

function stem(): string {
  const first = positionals(new Set())[0] ?? "imu";
  return first.replace(/\.[^.]*$/, "").replace(/[^A-Za-z0-9_-]+/g, "-").replace(/^-+|-+$/g, "") || "imu";
}

function command_of(one: Job): readonly Option[] {
  return COMMANDS.commands.find((command) => command.name === one.command.join(" "))?.options ?? [];
}

function field(one: Job, option: Option): HTMLElement {
  const name = option.long ?? option.id;
  const id = `option-${name}`;
  const help = `${id}-help`;
  const kind = one.inputs[name];
  const preset = query.get(name) ?? (kind ? found.find((file) => file.kind === kind)?.file : one.defaults[name]?.replace("NAME", stem())) ?? "";
  const common = { id, name, "aria-describedby": help };
  const choose = (values: readonly string[]): HTMLElement => {
    const select = h("select", common, ...["", ...values].map((value) => h("option", { value, selected: value === preset }, value || "–")));
    return select;
  };
  let input: HTMLElement;
  if (!option.takes_value) input = h("input", { ...common, type: "checkbox", checked: query.has(name) });
  else if (kind !== undefined) input = choose([...files.keys()]);
  else if (option.possible_values.length > 0 && !option.default) input = choose(option.possible_values);
  else input = h("input", { ...common, type: "text", value: preset, placeholder: option.default ?? option.value_name ?? "", spellcheck: "false", "aria-required": String(option.required) });
  const more = (option.long_help ?? "").replace(option.help, "").trim();
  return h("div", { class: option.takes_value ? "field" : "field flag", lang: "en" },
    h("label", { for: id }, option.help, " ", h("code", {}, `--${name}`)), input,
    h("p", { id: help, class: "muted" }, more));
}

function draw(): void {
  document.documentElement.lang = language === "zh" ? "zh-Hans" : "en";
  for (const one of document.querySelectorAll<HTMLElement>("[data-word]")) one.textContent = word(one.dataset["word"] ?? "");
  element("language").textContent = language === "zh" ? "English" : "中文";
  element("language").lang = language === "zh" ? "en" : "zh-Hans";
  element("found-section").hidden = found.length === 0;
  element("job-section").hidden = files.size === 0;
  element("found").replaceChildren(...found.map(card));
  if (files.size > 0) draw_form();
}

function draw_form(): void {
  const advice = (one: Job): Advice | undefined => found.flatMap((file) => file.jobs).find((each) => each.job === one.job);
  const radios = h("div", { class: "jobs", role: "radiogroup", "aria-label": word("job") }, ...JOBS.map((one) => {
    const good = advice(one)?.good === true;
    return h("label", { class: good ? "good-job" : "" },
      h("input", { type: "radio", name: "job", value: one.job, checked: one === job }),
      h("span", {}, h("strong", {}, word(one.job)), good ? h("span", { class: "tag" }, word("fits")) : "", h("small", {}, word(`${one.job}_what`))));
  }));
  const parts: HTMLElement[] = [radios];
  const chosen = job;
  if (chosen) {
    const options = command_of(chosen).filter((option) => !option.positional && !HIDDEN.has(option.id) && !((option.long ?? "") in chosen.outputs));
    const main = chosen.main.flatMap((name) => options.filter((option) => option.long === name));
    const asked = query.get("choices")?.split(",") ?? (chosen.job === "warm-up" ? [found[0]?.format === "DataFlash" ? "ardupilot" : "px4"] : []);
    const reason = advice(chosen)?.reason;
    parts.push(
      reason ? h("p", { class: "reason", lang: "en" }, reason) : h("p", { hidden: true }),
      h("div", { class: "fields" }, ...main.map((option) => field(chosen, option))),
      h("fieldset", { class: "choices", hidden: Object.keys(chosen.choices).length === 0 }, h("legend", {}, word("also_write")),
        ...Object.keys(chosen.choices).map((name) => h("label", {}, h("input", { type: "checkbox", name: "choice", value: name, checked: asked.includes(name) }), ` ${word(`choice_${name}`)}`))),
      h("details", {}, h("summary", {}, word("all_options")), h("div", { class: "fields" },
        ...options.filter((option) => !main.includes(option)).map((option) => field(chosen, option)))),
      h("div", { class: "command" }, h("p", { id: "command-label" }, word("same_command")),
        h("pre", { id: "command", lang: "en", tabindex: "0", role: "group", "aria-labelledby": "command-label" }),
        h("button", { type: "button", id: "copy", class: "quiet" }, word("copy"))),
      h("button", { type: "submit", id: "run", class: "primary" }, word("run")));
  }
  element("form").replaceChildren(...parts);
  show_command();
}

function value_of(name: string): string {
  const input = document.getElementById(`option-${name}`);
  if (input instanceof HTMLSelectElement) return input.value;
  if (!(input instanceof HTMLInputElement)) return "";
  return input.type === "checkbox" ? (input.checked ? "yes" : "") : input.value.trim();
}

function positionals(used: ReadonlySet<string>): string[] {
  return [...files.keys()].filter((name) => !used.has(name));
}

/** The arguments of the command that the form says. */
function args_of(one: Job): string[] {
  const options = command_of(one).filter((option) => !option.positional && option.long);
  const used = new Set(Object.keys(one.inputs).map(value_of));
  const many = found.some((file) => file.imus > 1) && !value_of("instance");
  let name = value_of("imu").replace(/[^A-Za-z0-9_-]+/g, "-") || stem();
  const outputs = (name: string): string[] => Object.values(one.outputs).map((file) => file.replace("NAME", name));
  while (outputs(name).some((file) => files.has(file))) name += "-new";
  const named = (template: string): string => template.replace("NAME", name);
  const args = [...one.command, ...positionals(used).map(argument)];
  for (const option of options) {
    const value = value_of(option.long ?? "");
    if (!value) continue;
    if (!option.takes_value) args.push(`--${option.long}`);
    else if (value.startsWith("-")) args.push(`--${option.long}=${value}`);
    else args.push(`--${option.long}`, option.long === "output" && many ? several(value) : value);
  }
  for (const [option, template] of Object.entries(one.outputs)) {
    args.push(`--${option}`);
    if (template) args.push(option === "output" && many ? several(named(template)) : named(template));
  }
  for (const box of element("form").querySelectorAll<HTMLInputElement>("[name=choice]:checked")) args.push(...(one.choices[box.value] ?? []).map(named));
  return args;
}

function several(file: string): string {
  return file.includes("{") ? file : file.replace(/(\.[^.]*)?$/, "-{instance}$1");
}

function quoted(part: string): string {
  return /^[A-Za-z0-9_.,:=/@%+-]+$/.test(part) ? part : `'${part.replaceAll("'", "'\\''")}'`;
}

function show_command(): void {
  const line = document.getElementById("command");
  if (line && job) line.textContent = ["isotherm", ...args_of(job)].map(quoted).join(" ").replace(/ --output /g, " -o ");
}

/* A run, and what it gave */

async function start(one: Job): Promise<void> {
  const args = args_of(one);
  const total = [...files.values()].reduce((sum, file) => sum + file.size, 0);
  const bar = element("progress") as HTMLProgressElement;
  const on_read = (bytes: number): void => {
    bar.value = total ? (bytes % total) / total : 0;
    element("read").textContent = word("read").replace("{read}", size(bytes)).replace("{total}", size(total));
  };
  element("outcome").replaceChildren();
  element("running").hidden = false;
  on_read(0);
  bar.removeAttribute("value");
  say("running");
  (element("run") as HTMLButtonElement).disabled = true;
  element("stop").focus();
  try {
    const outcome = await run(args, on_read);
    if (!outcome) say("stopped");
    else if (outcome.code !== 0 && outcome.files.size === 0) refuse(outcome);
    else await result(one, outcome);
  } finally {
    element("running").hidden = true;
    (element("run") as HTMLButtonElement).disabled = false;
  }
}

function size(bytes: number): string {
  return bytes < 1e6 ? `${Math.ceil(bytes / 1e3)} kB` : bytes < 1e9 ? `${(bytes / 1e6).toFixed(1)} MB` : `${(bytes / 1e9).toFixed(2)} GB`;
}

function show(section: HTMLElement): void {
  element("outcome").replaceChildren(section);
  const heading = section.querySelector("h2");
  heading?.focus();
  heading?.scrollIntoView({ block: "start" });
}

function refuse(outcome: Outcome): void {
  say("refused");
  show(h("section", { id: "refusal", class: "refusal", "data-code": String(outcome.code), "data-memory": String(outcome.memory), "aria-labelledby": "refusal-heading" },
    h("h2", { id: "refusal-heading", tabindex: "-1" }, word("refused")),
    h("p", {}, word("refused_what").replace("{code}", String(outcome.code))),
    h("pre", { id: "words", lang: "en", tabindex: "0" }, outcome.stderr)));
}

async function result(one: Job, outcome: Outcome): Promise<void> {
  const outputs = new Map(outcome.files);
  const json = "json" in one.outputs ? (JSON.parse(text(outcome.stdout)) as Json) : null;
  const printed = text(outcome.stdout);
  if (json !== null) outputs.set(`${one.job}.json`, outcome.stdout);
  const digests = [...outputs].flatMap(([name, data]) => (name.endsWith(".toml") ? [/^digest = "(.*)"/m.exec(text(data))?.[1] ?? []] : [])).flat();
  const report = [...outputs].find(([name]) => name.endsWith(".html"));
  const links = [...outputs].map(([name, data]) => h("li", {}, h("a", {
    href: URL.createObjectURL(new Blob([data], { type: "application/octet-stream" })), download: name.replaceAll("/", "-"), "data-output": name,
  }, english(name)), ` ${size(data.length)}`));
  const names = [...new Set([...outcome.stderr.matchAll(/\[([a-z0-9-]+)\]: /g)].map((match) => match[1] ?? ""))];
  const meaning = names.length ? await run(["explain", ...names]) : null;
  const section = h("section", { id: "result", class: "result", "data-job": one.job, "data-digest": digests.join(" "), "data-code": String(outcome.code), "data-memory": String(outcome.memory), "aria-labelledby": "result-heading" },
    h("h2", { id: "result-heading", tabindex: "-1" }, word(outcome.code ? "incomplete" : "result")),
    ...figures(one, json),
    printed && json === null ? h("pre", { lang: "en", tabindex: "0" }, printed) : "",
    h("h3", {}, word("downloads")), h("ul", { class: "downloads" }, ...links),
    outcome.stderr ? h("details", { open: true }, h("summary", {}, word("said")), h("pre", { id: "words", lang: "en", tabindex: "0" }, outcome.stderr)) : "",
    meaning ? h("details", {}, h("summary", {}, word("meaning")), h("pre", { lang: "en", tabindex: "0" }, text(meaning.stdout))) : "");
  if (report) section.append(h("h3", {}, word("report")), h("iframe", { sandbox: "", title: word("report"), srcdoc: text(report[1]) }));
  say("done");
  show(section);
}

function at(json: Json, path: string): Json {
  let here: Json = json;
  for (const key of path.split(".")) here = here !== null && typeof here === "object" ? ((here as Record<string, Json>)[key] ?? null) : null;
  return here;
}

function figure(value: Json): string {
  return typeof value === "number" ? String(Number(value.toPrecision(3))) : value === null ? "–" : String(value);
}

/** The headline of a result: a sentence of the command, and a row for each sensor. */
function figures(one: Job, json: Json): HTMLElement[] {
  if (json === null) return [];
  const several = at(json, "imus");
  const documents = Array.isArray(several) ? several.map((imu: Json) => at(imu, "calibration")) : [json];
  return documents.flatMap((document: Json) => {
    const sentence = one.sentence ? at(document, one.sentence) : null;
    const tables = Object.entries(one.figures).map(([list, columns]) => {
      const rows = at(document, list);
      return h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": word("figures") }, h("table", {},
        h("thead", {}, h("tr", {}, ...columns.map((column) => h("th", { scope: "col" }, word(`column_${column}`))))),
        h("tbody", { lang: "en" }, ...(Array.isArray(rows) ? rows : []).map((row: Json) => h("tr", {}, ...columns.map((column) => h("td", {}, figure(at(row, column)))))))));
    });
    return [h("p", { lang: "en", class: "sentence" }, typeof sentence === "string" ? sentence : ""), ...tables];
  });
}

/* What a person does */

element("files").addEventListener("change", (event) => void take((event.target as HTMLInputElement).files ?? []));
element("example").addEventListener("click", async () => {
  example ??= bytes_of("log").then(async (response) => new File([await response.blob()], "example.ulg"));
  await take([await example]);
});
let example: Promise<File> | undefined;
for (const kind of ["dragover", "dragleave", "drop"] as const) {
  document.addEventListener(kind, (event) => {
    event.preventDefault();
    element("drop").classList.toggle("over", kind === "dragover");
    if (kind === "drop" && event.dataTransfer?.files.length) void take(event.dataTransfer.files);
  });
}
element("language").addEventListener("click", () => {
  language = language === "en" ? "zh" : "en";
  draw();
});
element("form").addEventListener("input", (event) => {
  const input = event.target as HTMLInputElement;
  if (input.name !== "job") return show_command();
  job = JOBS.find((one) => one.job === input.value);
  draw_form();
  element("form").querySelector<HTMLInputElement>("[name=job]:checked")?.focus();
});
element("form").addEventListener("submit", (event) => {
  event.preventDefault();
  if (job) void start(job);
});
element("form").addEventListener("click", (event) => {
  if ((event.target as HTMLElement).id === "copy") void navigator.clipboard.writeText(text_of("command")).then(() => say("copied"));
});
element("stop").addEventListener("click", () => stop());
draw();
engine.then(() => (document.documentElement.dataset["ready"] = ""), () => say("no_engine"));
