/** The page: what was found in the files, a form of each job's options, its command line, and what a run gave. */
import jobs from "./jobs.json";
import type { Outcome, Progress, Run } from "./worker";
import words from "./words.json";

/** An option, as `isotherm arguments` describes it. */
interface Option {
  readonly long: string | null;
  readonly help: string;
  readonly long_help: string;
  readonly value_name: string | null;
  readonly default: string | null;
  readonly possible_values: readonly { readonly name: string }[];
  readonly required: boolean;
  readonly takes_value: boolean;
}
/** What `isotherm describe` says of a file. */
interface Found {
  readonly file: string;
  readonly kind: string;
  readonly format: string;
  readonly imus: readonly Json[];
  readonly jobs: readonly { readonly job: string; readonly good: boolean; readonly reason: string }[];
  readonly findings: readonly Finding[];
  readonly notes: readonly string[];
  readonly error: string | null;
}
type Finding = Readonly<Record<"name" | "severity" | "message", string> & Partial<Record<"meaning" | "remedy", string>>>;
/** A job of the page: NAME in a file name stands for that of the IMU. */
interface Job {
  readonly job: string;
  readonly command: string;
  /** Kinds of files that it reads. */
  readonly takes: readonly string[];
  /** Options that come first, what they are preset with, and those that name a file of a kind. */
  readonly main: readonly string[];
  readonly defaults: Texts;
  readonly inputs: Texts;
  readonly outputs: Texts;
  readonly choices: Readonly<Record<string, readonly string[]>>;
  /** The sentence of the JSON, and the columns of its lists, that are the headline. */
  readonly sentence: string;
  readonly figures: Readonly<Record<string, readonly string[]>>;
}
type Texts = Readonly<Record<string, string>>;
type Json = null | boolean | number | string | readonly Json[] | { readonly [key: string]: Json };

const JOBS = jobs as unknown as readonly Job[];
const { commands } = JSON.parse(element("options").textContent ?? "") as {
  readonly commands: readonly { readonly name: string; readonly options: readonly Option[] }[];
};
const FACTS = ["imu", "instance", "rows", "rate_hz", "duration_s", "temperature", "attitudes"];
const HIDDEN = ["quiet", "verbose", "domain"];
const query = new URLSearchParams(location.search);
const files = new Map<string, File>();
let found: readonly Found[] = [];
let language: keyof typeof words = (query.get("lang") ?? navigator.language).startsWith("zh") ? "zh" : "en";
let job = JOBS.find((one) => one.job === query.get("job"));
let stop = (): void => undefined;
let example: Promise<File> | undefined;

function element<E extends HTMLElement>(id: string): E {
  return document.getElementById(id) as E;
}

function word(name: string, values: Texts = {}): string {
  const text = (words[language] as Texts)[name] ?? name;
  return text.replace(/\{(\w+)\}/g, (_, key: string) => values[key] ?? "");
}

/** An element with attributes and children. Texts never become markup. */
function h<K extends keyof HTMLElementTagNameMap>(
  tag: K, attributes: Readonly<Record<string, string | boolean>> = {}, ...children: (Node | string | false)[]
): HTMLElementTagNameMap[K] {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes))
    if (value !== false) made.setAttribute(name, value === true ? "" : value);
  made.append(...children.filter((child) => child !== false));
  return made;
}

/** Sets the words of the page's own texts; what they count is in the attributes of their section. */
function translate(): void {
  document.documentElement.lang = language === "zh" ? "zh-Hans" : "en";
  for (const one of document.querySelectorAll<HTMLElement>("[data-word]"))
    one.textContent = word(one.dataset["word"] ?? "", one.closest("section")?.dataset as Texts | undefined);
  element("found").replaceChildren(...found.map(card));
}

const say = (name: string): void => void (element("status").textContent = name && word(name));
const text = (data: Uint8Array): string => new TextDecoder().decode(data);

/* The engine */

/** What is packed in the page under this name. */
function unpacked(id: string): Response {
  const letters = atob((element(id).textContent ?? "").trim());
  const packed = new Uint8Array(letters.length);
  for (let n = 0; n < letters.length; n += 1) packed[n] = letters.charCodeAt(n);
  element(id).remove();
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream, { headers: { "content-type": "application/wasm" } });
}

const engine = WebAssembly.compileStreaming(unpacked("engine"));
const worker_url = URL.createObjectURL(new Blob([element("worker").textContent ?? ""], { type: "text/javascript" }));

/** Runs the command in a worker of its own. Null: it was stopped. */
async function run(args: readonly string[], on_read?: (bytes: number) => void): Promise<Outcome | null> {
  const module = await engine;
  const worker = new Worker(worker_url);
  try {
    return await new Promise((resolve, reject) => {
      stop = (): void => resolve(null);
      worker.onmessage = ({ data }: MessageEvent<Progress | Outcome>): void =>
        "code" in data ? resolve(data) : on_read?.(data.read);
      worker.onerror = (event): void => reject(new Error(event.message));
      worker.postMessage({ module, args, files } satisfies Run);
    });
  } finally {
    worker.terminate();
  }
}

/* Files, and what was found in them */

async function take(chosen: Iterable<File>): Promise<void> {
  // A table or a mapping joins the files that are there.
  if (![...chosen].some((file) => file.name.endsWith(".toml"))) files.clear();
  for (const file of chosen) {
    let name = file.name;
    for (let n = 2; files.has(name); n += 1) name = file.name.replace(/(\.[^.]*)?$/, ` (${n})$1`);
    files.set(name, file);
  }
  found = [];
  if (files.size === 0) return;
  const outcome = await execute("looking", ["describe", ...[...files.keys()].map(argument), "--json"]);
  try {
    if (outcome) found = (JSON.parse(text(outcome.stdout)) as { files: readonly Found[] }).files;
  } catch {
    if (outcome) await show("refusal", outcome);
  }
  const tables = found.filter((one) => one.kind === "table").length;
  const has_data = found.some((one) => one.kind === "recording" || one.kind === "data");
  const liked = tables === 0 ? "" : has_data ? "verify" : tables > 1 ? "compare" : "export";
  if (!query.has("job")) job = JOBS.find((one) => one.job === liked) ?? JOBS.find(fits);
  element("found-section").hidden = found.length === 0;
  element("job-section").hidden = false;
  draw_form();
  if (outcome) say("");
  element("found-section").scrollIntoView({ block: "nearest" });
}

function fits(one: Job): boolean {
  return found.some((file) => file.jobs.some((each) => each.job === one.command && each.good));
}

/** A name as the command takes it: one with a hyphen in front is none of its options. */
function argument(name: string): string {
  return name.startsWith("-") ? `./${name}` : name;
}

function card(one: Found): HTMLElement {
  const good = JOBS.filter((each) => one.jobs.some((fit) => fit.job === each.command && fit.good));
  return h("article", { class: "card", "data-file": one.file },
    h("h3", { lang: "en" }, one.file, h("span", { class: "tag" }, one.format)),
    ...one.imus.map((imu) => h("dl", {}, ...FACTS.filter((name) => at(imu, name) !== null).map((name) =>
      h("div", {}, h("dt", {}, word(name)), h("dd", {}, name === "temperature" ? span(imu) : cell(at(imu, name))))))),
    !!one.error && h("pre", { class: "bad", lang: "en", tabindex: "0" }, one.error), proposal(one.error ?? ""),
    good.length > 0 && h("p", {}, word("good_for", { jobs: good.map((each) => word(each.job)).join(word("comma")) })),
    findings(one.findings),
    ...one.notes.map((note) => h("p", { class: "muted", lang: "en" }, note)));
}

/** The mapping that the command proposes for a text of columns, to be saved. */
function proposal(words: string): HTMLElement {
  const mapping = /^format = 1\n[^]*/m.exec(words)?.[0];
  return h("p", { hidden: !mapping }, word("proposal"), " ", link("mapping.toml", new TextEncoder().encode(mapping ?? "")));
}

function link(name: string, data: Uint8Array<ArrayBuffer>): HTMLElement {
  const href = URL.createObjectURL(new Blob([data]));
  return h("a", { href, download: name.replaceAll("/", "-"), "data-output": name, lang: "en" }, name);
}

function span(imu: Json): string {
  const [low, high] = ["low", "high"].map((end) => Number(at(imu, `temperature.${end}`)).toFixed(1));
  const unit = String(at(imu, "temperature.unit") ?? "").replace("degC", "°C");
  return at(imu, "temperature.is_placeholder") ? "–" : `${low} … ${high} ${unit}`;
}

function findings(all: readonly Finding[]): HTMLElement {
  return h("ul", { class: "findings", lang: "en", hidden: all.length === 0 }, ...all.map((one) =>
    h("li", { class: one.severity }, h("p", {}, h("strong", {}, `${one.severity} [${one.name}] `), one.message),
      h("p", {}, [one.meaning, one.remedy].filter(Boolean).join(" ")))));
}

/* The form of a job */

function draw_form(): void {
  element("jobs").replaceChildren(...JOBS.map((one) => h("label", {},
    h("input", { type: "radio", name: "job", value: one.job, checked: one === job }),
    h("span", {}, h("strong", { "data-word": one.job }),
      fits(one) && h("span", { class: "tag", "data-word": "fits" }), h("small", { "data-word": `${one.job}_what` })))));
  element("job-form").hidden = !job;
  if (!job) return translate();
  const one = job;
  const hidden = [...HIDDEN, ...Object.keys(one.outputs)];
  const options = command_of(one).filter(({ long }) => long && !hidden.includes(long));
  const main = one.main.flatMap((name) => options.filter((option) => option.long === name));
  const asked = query.get("choices") ?? (found.some((file) => file.format.includes("DataFlash")) ? "ardupilot" : "px4");
  const reasons = found.map((file) => `${file.file}: ${file.jobs.find((each) => each.job === one.command)?.reason}.`);
  element("reason").textContent = fits(one) ? "" : reasons.join(" ");
  element("main-fields").replaceChildren(...main.map((option) => field(one, option)));
  const others = options.filter((option) => !main.includes(option));
  element("other-fields").replaceChildren(...others.map((option) => field(one, option)));
  element("choices-set").hidden = Object.keys(one.choices).length === 0;
  element("choices").replaceChildren(...Object.keys(one.choices).map((name) => h("label", {},
    h("input", { type: "checkbox", name: "choice", value: name, checked: asked.split(",").includes(name) }),
    h("span", { "data-word": `choice_${name}` }))));
  translate();
  show_command();
}

function command_of(one: Job): readonly Option[] {
  return commands.find((command) => command.name === one.command)?.options ?? [];
}

function field(one: Job, option: Option): HTMLElement {
  const name = option.long ?? "";
  const kind = one.inputs[name];
  const several = found.find((file) => file.imus.length > 1);
  const first = name === "instance" && several && one.defaults["instance"] === "first" ? cell(at(several.imus[0] ?? null, name)) : "";
  const usual = kind ? found.find((file) => file.kind === kind)?.file : one.defaults[name]?.replace("NAME", stem());
  const preset = query.get(name) ?? (name === "instance" ? first : usual) ?? "";
  const common = { id: `option-${name}`, name, "aria-describedby": `help-${name}` };
  const values = kind === undefined ? option.possible_values.map((value) => value.name) : [...files.keys()];
  const input = !option.takes_value ? h("input", { ...common, type: "checkbox", checked: query.has(name) })
    : kind !== undefined || (values.length > 0 && name !== "drop")
      ? h("select", common, ...["", ...values].map((value) =>
        h("option", { value, selected: value === preset }, value || option.default || "–")))
      : h("input", { ...common, value: preset, placeholder: option.default ?? option.value_name ?? "", spellcheck: "false",
        "aria-required": String(option.required) });
  return h("div", { class: option.takes_value ? "field" : "field flag", lang: "en" },
    h("label", { for: common.id }, option.help, " ", h("code", {}, `--${name}`)), input,
    h("p", { id: `help-${name}`, class: "muted" }, option.long_help.replace(option.help, "").trim()));
}

/** A name for the IMU: that of its table, or one made of the first file's. */
function stem(): string {
  const imu = at(found.find((file) => file.kind === "table")?.imus[0] ?? null, "imu");
  const name = [...files.keys()][0]?.replace(/\.[^.]*$/, "").toLowerCase().replace(/[^a-z0-9_-]+/g, "-").slice(0, 32);
  return imu ? String(imu) : name?.replace(/^-+|-+$/g, "") || "imu";
}

function value_of(name: string | null): string {
  const input = document.getElementById(`option-${name}`);
  if (input instanceof HTMLInputElement && input.type === "checkbox") return input.checked ? "yes" : "";
  return input instanceof HTMLInputElement || input instanceof HTMLSelectElement ? input.value.trim() : "";
}

/** The arguments of the command that the form says. */
function args_of(one: Job): string[] {
  const used = Object.keys(one.inputs).map(value_of);
  let name = value_of("imu").replace(/[^A-Za-z0-9_-]+/g, "-") || stem();
  while (Object.values(one.outputs).some((file) => files.has(file.replace("NAME", name)))) name += "-new";
  const several = found.some((file) => file.imus.length > 1) && !value_of("instance");
  const kind = (file: string): string => found.find((each) => each.file === argument(file))?.kind ?? "unknown";
  const taken = [...files.keys()].filter((file) => !used.includes(file) && ["unknown", ...one.takes].includes(kind(file)));
  const args = [...one.command.split(" "), ...taken.map(argument)];
  for (const { long, takes_value } of command_of(one)) {
    const value = value_of(long);
    if (!value) continue;
    if (takes_value && !value.startsWith("-")) args.push(`--${long}`, value);
    else args.push(takes_value ? `--${long}=${value}` : `--${long}`);
  }
  for (const [option, file] of Object.entries(one.outputs))
    args.push(`--${option}`, ...(file ? [file.replace("NAME", name)] : []));
  for (const box of document.querySelectorAll<HTMLInputElement>("[name=choice]:checked"))
    args.push(...(one.choices[box.value] ?? []).map((part) => part.replace("NAME", name)));
  const output = args.indexOf("--output") + 1;
  if (output && several) args[output] = (args[output] ?? "").replace(/(-\{instance\})?(\.[^.]*)?$/, "-{instance}$2");
  return args;
}

function show_command(): void {
  const quoted = (part: string): string =>
    /^[\w.,:=/@%+-]+$/.test(part) ? part : `'${part.replaceAll("'", "'\\''")}'`;
  const parts = job ? ["isotherm", ...args_of(job)].map(quoted) : [];
  element("command").replaceChildren(...parts.flatMap((part) => [h("span", {}, part), " "]));
}

/* A run, and what it gave */

async function start(one: Job): Promise<void> {
  const outcome = await execute("running", args_of(one));
  if (!outcome) return;
  if (outcome.code !== 0 && outcome.files.size === 0) await show("refusal", outcome);
  else await result(one, outcome);
}

/** Runs the command, shows how far it has read, and lets a person stop it. */
async function execute(words: string, args: readonly string[]): Promise<Outcome | null> {
  stop();
  const total = [...files.values()].reduce((sum, file) => sum + file.size, 1);
  const bar = element<HTMLProgressElement>("progress");
  element("outcome").replaceChildren();
  element("read").textContent = "";
  bar.removeAttribute("value");
  say(words);
  element("running").hidden = false;
  const outcome = await run(args, (bytes) => {
    bar.value = (bytes % total) / total;
    element("read").textContent = word("read", { read: size(bytes), total: size(total) });
  });
  element("running").hidden = true;
  return outcome;
}

function size(bytes: number): string {
  return bytes < 1e6 ? `${Math.ceil(bytes / 1e3)} kB` : `${(bytes / 1e6).toFixed(bytes < 1e8 ? 1 : 0)} MB`;
}

/** Shows what a run gave, and what the names in brackets mean. */
async function show(kind: string, outcome: Outcome, fill?: (section: HTMLElement) => void): Promise<void> {
  const names = new Set([...outcome.stderr.matchAll(/\[([a-z0-9-]+)\]/g)].map((match) => match[1] ?? ""));
  let meaning = "";
  for (const name of names) meaning += text((await run(["explain", name]))?.stdout ?? new Uint8Array());
  element("outcome").replaceChildren(element<HTMLTemplateElement>(`${kind}-template`).content.cloneNode(true));
  const section = element(kind);
  Object.assign(section.dataset, { code: outcome.code, memory: outcome.memory });
  element("words").textContent = outcome.stderr;
  element("meaning").hidden = !meaning;
  element("meaning").lastElementChild!.textContent = meaning;
  if (kind === "refusal" && outcome.code === 101) element("code").dataset["word"] = "ended";
  fill?.(section);
  translate();
  say(kind === "result" ? "done" : "refused");
  element("outcome-heading").focus({ preventScroll: true });
  section.scrollIntoView({ block: "start" });
}

async function result(one: Job, outcome: Outcome): Promise<void> {
  const outputs = new Map(outcome.files);
  const printed = text(outcome.stdout);
  const json = "json" in one.outputs ? (JSON.parse(printed) as Json) : null;
  if (json !== null) outputs.set(`${stem()}.json`, outcome.stdout);
  const tables = [...outputs].filter(([name]) => name.endsWith(".toml")).map(([, data]) => text(data));
  const report = [...outputs].find(([name]) => name.endsWith(".html"));
  await show("result", outcome, (section) => {
    const digest = tables.map((table) => /^digest = "(.*)"/m.exec(table)?.[1] ?? "").join(" ");
    Object.assign(section.dataset, { job: one.job, digest });
    element("code").hidden = outcome.code === 0;
    element("printed").textContent = json === null ? printed : "";
    element("figures").replaceChildren(...documents(json).flatMap((document) => figures(one, document)));
    const all = documents(json).map((document) => (at(document, "findings") ?? []) as unknown as readonly Finding[]);
    element("findings").replaceChildren(...all.map(findings));
    element("said").hidden = !outcome.stderr;
    for (const [name, data] of outputs) element("downloads").append(h("li", {}, link(name, data), size(data.length)));
    element("report").hidden = !report;
    if (report) section.querySelector("iframe")!.srcdoc = text(report[1]);
  });
}

function at(json: Json, path: string): Json {
  return path.split(".").reduce((here: Json, key) => (here as Record<string, Json> | null)?.[key] ?? null, json);
}

/** A document of each IMU of the log. */
function documents(json: Json): readonly Json[] {
  const imus = at(json, "imus") as readonly Json[] | null;
  return imus ? imus.map((imu) => at(imu, "calibration")) : json === null ? [] : [json];
}

function cell(value: Json): string {
  if (typeof value !== "number" || Number.isInteger(value)) return String(value ?? "–");
  return String(Number(value.toPrecision(3)));
}

/** The headline of a result: a sentence of the command, and a row for each sensor. */
function figures(one: Job, document: Json): HTMLElement[] {
  const tables = Object.entries(one.figures).map(([list, columns]) => h("table", {},
    h("thead", {}, h("tr", {}, ...columns.map((column) => h("th", { scope: "col", "data-word": `column_${column}` })))),
    h("tbody", { lang: "en" }, ...((at(document, list) ?? []) as Json[]).map((row) =>
      h("tr", {}, ...columns.map((column) => h("td", {}, cell(at(row, column)))))))));
  const region = { class: "scroll", tabindex: "0", role: "region", "aria-label": word("figures") };
  const sentence = String((one.sentence && at(document, one.sentence)) || "");
  return [h("p", { lang: "en", class: "sentence" }, sentence), h("div", region, ...tables)];
}

/* What a person does */

element<HTMLInputElement>("files").onchange = ({ target }): void => void take((target as HTMLInputElement).files ?? []);
element("example").onclick = async (): Promise<void> => {
  example ??= unpacked("log").blob().then((data) => new File([data], "warm-up.ulg"));
  await take([await example]);
};
element("about").ontoggle = async (): Promise<string> => (element("licences").textContent ||= await unpacked("texts").text());
for (const kind of ["dragover", "dragleave", "drop"] as const) {
  document.addEventListener(kind, (event) => {
    event.preventDefault();
    element("drop").classList.toggle("over", kind === "dragover");
    if (kind === "drop" && event.dataTransfer?.files.length) void take(event.dataTransfer.files);
  });
}
element("language").onclick = (): void => ((language = language === "en" ? "zh" : "en"), translate());
element("form").oninput = ({ target }): void => {
  const input = target as HTMLInputElement;
  if (input.name !== "job") return show_command();
  job = JOBS.find((one) => one.job === input.value);
  draw_form();
  document.querySelector<HTMLInputElement>("[name=job]:checked")?.focus();
};
element("form").onsubmit = (event): void => {
  event.preventDefault();
  if (job) void start(job);
};
element("copy").onclick = async (): Promise<void> => {
  await navigator.clipboard.writeText(element("command").textContent ?? "");
  say("copied");
};
element("stop").onclick = (): void => (stop(), say("stopped"));
draw_form();
engine.then(() => (document.documentElement.dataset["ready"] = performance.now().toFixed()), () => say("no_engine"));
