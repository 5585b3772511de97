//! Prints the document as tables, and describes the machine.

use isotherm_benches::{cores, first_line};
use serde_json::{Value, json};
use std::fs;

/// The description of the machine.
pub(crate) fn machine() -> Value {
    json!({
        "cpu": cpu(),
        "cores": cores().len(),
        "virtual": fs::read_to_string("/proc/cpuinfo").is_ok_and(|text| text.contains(" hypervisor")),
        "kernel": first_line("/proc/sys/kernel/osrelease"),
        "clock_source": first_line("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
        "governor": first_line("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"),
    })
}

fn cpu() -> Option<String> {
    let text = fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    line.split_once(": ").map(|(_, name)| name.to_owned())
}

/// Prints every part that the document has.
pub(crate) fn print(document: &Value) {
    let paced = &document["paced"];
    for (rate, series) in by_number(paced) {
        heading(&format!("round trips at {rate} Hz, caches used between samples [ns]"));
        path_rows(&series["paths"]);
        ratios("ratio, 95 % interval", &series["ratios"]);
        ratios("of undisturbed turns alone", &series["undisturbed_ratios"]);
        left_out(series);
    }
    if paced.is_object() {
        println!(
            "\n{} rounds of new processes; the acquisition's own work takes {} us between samples; {}",
            paced["rounds"],
            paced["own_work_us"],
            pinned(paced)
        );
    }
    if let Some(paths) = document["paths"].as_object() {
        heading("round trips, each sent when the one before it is answered [ns]");
        paths.iter().for_each(|(name, figures)| row(name, figures));
        println!("(the clock takes {} of each)", number(&document["clock_ns"]));
        ratios("ratio, 95 % interval", &document["ratios"]);
        println!(
            "\n{} rounds of new processes, {} blocks in all, {} disturbed by a preemption or the host; {}",
            document["rounds"],
            document["blocks"],
            document["disturbed_blocks"],
            pinned(document)
        );
    }
    if let Some(scenarios) = document["load"].as_object() {
        heading(&format!("sent at {} Hz, from the actual moment [ns]", document["rate_hz"]));
        for (name, figures) in scenarios {
            if let Some(cause) = figures["not_measured"].as_str() {
                println!("{name}: not measured: {cause}");
                continue;
            }
            row(name, &figures["no_reloads"]["from_send"]);
            row(&format!("{name}, reloads"), &figures["reloads"]["from_send"]);
            let ratios = &figures["ratios from_send, reloads/no_reloads"];
            println!(
                "{:>28} p99 {}, p99.9 {}; {} of {} turns left out of it: the host took their time",
                "reloads / none:",
                with_interval(&ratios["p99"]),
                with_interval(&ratios["p999"]),
                figures["disturbed_turns"],
                figures["turns"]
            );
        }
    }
    let scale = &document["scale"];
    if scale.is_object() {
        heading("round trips through one IMU, the others idle, one worker spinning [ns]");
        by_number(&scale["idle"]).into_iter().for_each(|(count, figures)| row(&format!("{count} IMUs"), figures));
        println!("(each idle stream costs {})", number(&scale["ns_per_idle_stream"]));
        for (count, series) in by_number(&scale["together"]) {
            heading(&format!("{count} IMUs at {} Hz together, until the last answer [ns]", scale["rate_hz"]));
            path_rows(&series["paths"]);
            if let Some(cause) = series["two_workers"].as_str() {
                println!("two workers: {cause}");
            }
            ratios("ratio, 95 % interval", &series["ratios"]);
            left_out(series);
        }
    }
    let throughput = &document["throughput"];
    if throughput.is_object() {
        println!("\n{} samples in flight, {} rounds", throughput["in_flight"], throughput["rounds"]);
        for name in ["isotherm", "iceoryx2"] {
            let path = &throughput[name];
            println!(
                "{name:<12} {:>9} samples/s {:>7} ns each",
                number(&path["samples_per_s"]),
                number(&path["ns_per_sample"])
            );
        }
        println!("time of a sample, isotherm / iceoryx2: {}", ratio(&throughput["ns_per_sample isotherm/iceoryx2"]));
    }
    footer(document);
}

fn heading(title: &str) {
    println!(
        "\n{title}\n{:<34} {:>9} {:>9} {:>9} {:>9} {:>9} {:>10} {:>9}",
        "", "p50", "p90", "p99", "p99.9", "p99.99", "max", "count"
    );
}

fn row(name: &str, figures: &Value) {
    let cell = |key: &str| number(&figures[key]);
    println!(
        "{name:<34} {:>9} {:>9} {:>9} {:>9} {:>9} {:>10} {:>9}",
        cell("p50_ns"),
        cell("p90_ns"),
        cell("p99_ns"),
        cell("p999_ns"),
        cell("p9999_ns"),
        cell("max_ns"),
        cell("count")
    );
}

/// A row for each path, with the worker's share of a core where it is known.
fn path_rows(paths: &Value) {
    for (name, figures) in paths.as_object().into_iter().flatten() {
        match figures["cpu_percent"].as_f64() {
            Some(share) => row(&format!("{name}, {share:.1} %"), figures),
            None => row(name, figures),
        }
    }
}

fn ratios(title: &str, ratios: &Value) {
    println!("\n{title:<42} {:>19} {:>19} {:>19} {:>19}", "p50", "p90", "p99", "p99.9");
    for (name, ratio) in ratios.as_object().into_iter().flatten() {
        let cell = |part: &str| with_interval(&ratio[part]);
        println!("{name:<42} {:>19} {:>19} {:>19} {:>19}", cell("p50"), cell("p90"), cell("p99"), cell("p999"));
    }
}

fn left_out(series: &Value) {
    println!("(the host took the machine in {} of {} turns)", series["disturbed_turns"], series["turns"]);
}

fn pinned(part: &Value) -> &'static str {
    if part["pinned"] == true { "pinned to two cores" } else { "not pinned" }
}

/// A ratio and its interval.
fn with_interval(value: &Value) -> String {
    let of = |name: &str| value[name].as_f64();
    let Some(((ratio, low), high)) = of("ratio").zip(of("low")).zip(of("high")) else { return "-".to_owned() };
    let digits = if ratio < 10.0 { 2 } else { 0 };
    format!("{ratio:.digits$} ({low:.digits$} {high:.digits$})")
}

/// The members of an object whose names are numbers, in their order.
fn by_number(object: &Value) -> Vec<(&String, &Value)> {
    let members = object.as_object().into_iter().flatten();
    let mut numbered: Vec<_> = members.filter_map(|member| Some((member.0.parse::<u32>().ok()?, member))).collect();
    numbered.sort_by_key(|(number, _)| *number);
    numbered.into_iter().map(|(_, member)| member).collect()
}

fn footer(document: &Value) {
    let machine = &document["machine"];
    let text = |name: &str| machine[name].as_str().unwrap_or("unknown").to_owned();
    println!(
        "\n{}, {} cores{}, kernel {}, clock source {}, governor {}; {:.0} s",
        text("cpu"),
        machine["cores"],
        if machine["virtual"] == true { " of a virtual machine" } else { "" },
        text("kernel"),
        text("clock_source"),
        text("governor"),
        document["seconds"].as_f64().unwrap_or_default()
    );
    println!(
        "- : fewer than 20 samples beyond it. Absolute times mean nothing on a shared machine; ratios of one run do."
    );
}

/// A number as text; `-` if it was not measured.
fn number(value: &Value) -> String {
    value.as_f64().map_or_else(|| "-".to_owned(), |value| format!("{value:.0}"))
}

fn ratio(value: &Value) -> String {
    value.as_f64().map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"))
}
