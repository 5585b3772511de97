//! Prints the document as tables.

use isotherm_benches::text::{heading, members, number, path_rows, ratios, row, with_interval};
use serde_json::Value;

/// Prints every part that the document has.
pub(crate) fn print(document: &Value) {
    print_paced(&document["paced"]);
    if document["paths"].is_object() {
        print_closed(document);
    }
    if document["load"].is_object() {
        print_load(document);
    }
    print_scale(&document["scale"]);
    print_throughput(&document["throughput"]);
}

fn print_paced(paced: &Value) {
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
}

fn print_closed(document: &Value) {
    heading("round trips, each sent when the one before it is answered [ns]");
    path_rows(&document["paths"]);
    println!("(the clock takes {} of each)", number(&document["clock_ns"], 0));
    ratios("ratio, 95 % interval", &document["ratios"]);
    println!(
        "\n{} rounds of new processes, {} blocks in all, {} disturbed by a preemption or the host; {}",
        document["rounds"],
        document["blocks"],
        document["disturbed_blocks"],
        pinned(document)
    );
}

fn print_load(document: &Value) {
    heading(&format!("sent at {} Hz, from the actual moment [ns]", document["rate_hz"]));
    for (name, figures) in members(&document["load"]) {
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

fn print_scale(scale: &Value) {
    if scale.is_object() {
        heading("round trips through one IMU, the others idle, one worker spinning [ns]");
        by_number(&scale["idle"]).into_iter().for_each(|(count, figures)| row(&format!("{count} IMUs"), figures));
        println!("(each idle stream costs {})", number(&scale["ns_per_idle_stream"], 0));
    }
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

fn print_throughput(throughput: &Value) {
    if throughput.is_object() {
        println!("\n{} samples in flight, {} rounds", throughput["in_flight"], throughput["rounds"]);
        for name in ["isotherm", "iceoryx2"] {
            let [rate, time] = ["samples_per_s", "ns_per_sample"].map(|figure| number(&throughput[name][figure], 0));
            println!("{name:<12} {rate:>9} samples/s {time:>7} ns each");
        }
        let ratio = number(&throughput["ns_per_sample isotherm/iceoryx2"], 2);
        println!("time of a sample, isotherm / iceoryx2: {ratio}");
    }
}

fn left_out(series: &Value) {
    println!("(the host took the machine in {} of {} turns)", series["disturbed_turns"], series["turns"]);
}

fn pinned(part: &Value) -> &'static str {
    if part["pinned"] == true { "pinned to two cores" } else { "not pinned" }
}

/// The members of an object whose names are numbers, in their order.
fn by_number(object: &Value) -> Vec<(&String, &Value)> {
    let mut numbered: Vec<_> =
        members(object).filter_map(|member| Some((member.0.parse::<u32>().ok()?, member))).collect();
    numbered.sort_by_key(|(number, _)| *number);
    numbered.into_iter().map(|(_, member)| member).collect()
}
