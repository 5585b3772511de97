//! The harness itself: what a strict run does with a test that is skipped.

use isotherm_tests::{Needs, skip, text};
use std::path::Path;
use std::process::{Command, Output};
use std::{env, fs};

/// Set in a child process. It says what the child's test needs: `program` or `machine`.
const CHILD: &str = "ISOTHERM_TESTS_CHILD";
/// The only test here.
const TEST: &str = "harness::a_strict_run_fails_without_a_program_and_lists_what_the_machine_lacks";

/// Runs the test in a child process, so that the variables do not reach other tests. There the test is skipped.
fn child(needs: &str, variables: &[(&str, &Path)]) -> Output {
    let mut command = Command::new(env::current_exe().unwrap());
    command.args(["--exact", TEST, "--nocapture", "--test-threads=2"]).env(CHILD, needs);
    command.env_remove("ISOTHERM_TESTS_STRICT").env_remove("ISOTHERM_TESTS_SKIPPED");
    command.envs(variables.iter().copied()).output().unwrap()
}

#[test]
fn a_strict_run_fails_without_a_program_and_lists_what_the_machine_lacks() {
    match env::var(CHILD).as_deref() {
        Ok("program") => return skip("no anvil", Needs::Program),
        Ok(_) => return skip("no hammer", Needs::Machine),
        Err(_) => {}
    }
    let folder = tempfile::tempdir().unwrap();
    let list = folder.path().join("skipped.txt");
    let listed = || fs::read_to_string(&list).ok();
    let on = ("ISOTHERM_TESTS_STRICT", Path::new("1"));
    let names_list = ("ISOTHERM_TESTS_SKIPPED", list.as_path());

    // Without strict nothing fails and nothing is listed.
    for variables in [&[][..], &[names_list], &[("ISOTHERM_TESTS_STRICT", Path::new("0")), names_list]] {
        for (needs, why) in [("program", "not tested: no anvil"), ("machine", "not tested: no hammer")] {
            let output = child(needs, variables);
            let stderr = text(&output.stderr);
            assert!(output.status.success() && stderr.contains(why), "{needs} {variables:?}: {stderr}");
            assert_eq!(listed(), None, "{needs} {variables:?}");
        }
    }

    let missing_program = child("program", &[on, names_list]);
    let stderr = text(&missing_program.stderr);
    assert!(!missing_program.status.success(), "{stderr}");
    assert!(stderr.contains(&format!("{TEST} is not done: no anvil; install it")), "{stderr}");
    assert_eq!(listed(), None);

    // Each skip adds a line.
    for count in 1..=2 {
        let output = child("machine", &[on, names_list]);
        assert!(output.status.success(), "{}", text(&output.stderr));
        assert_eq!(listed(), Some(format!("{TEST}: no hammer\n").repeat(count)));
    }

    // What the machine lacks must not be lost.
    let without_list = child("machine", &[on]);
    let stderr = text(&without_list.stderr);
    assert!(!without_list.status.success() && stderr.contains("needs ISOTHERM_TESTS_SKIPPED"), "{stderr}");
}
