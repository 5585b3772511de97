//! Reads what valgrind's tool `lackey` prints, and counts cache lines in it.

use crate::subject::{STEPS, WARMING};
use isotherm_benches::BenchResult;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::io::BufRead;

/// Bits of an address within a cache line.
const LINE_BITS: u32 = 6;
/// The source file whose last store in a step submits a sample to the other side.
const SUBMITS: &str = "safely_overflowing_index_queue.rs";

/// Whose an instruction is.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum Owner {
    Isotherm,
    Iceoryx2,
    /// The C library, the standard library where it is not inlined, other crates.
    Other,
}

/// Whose an instruction is, and its source file.
pub(crate) type Source = (Owner, String);

/// The first column of a line of the trace.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum Kind {
    Instruction,
    Store,
    /// A load, or a load and a store in one instruction.
    Load,
}

/// One access of a sample.
#[derive(Debug)]
pub(crate) struct Access {
    step: usize,
    pub kind: Kind,
    pub address: u64,
    size: u64,
}

/// The accesses of each sample, and where the program is loaded.
#[derive(Debug, Default)]
pub(crate) struct Trace {
    pub samples: Vec<Vec<Access>>,
    pub base: u64,
}

/// Lines that a step is the first of its process to touch: data and code by owner, and of both those that are cold,
/// because what keeps the process warm has not touched them. All samples together.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Lines {
    pub touched: [[usize; 3]; 2],
    pub cold: [usize; 2],
}

impl Trace {
    /// Reads a trace, with what the subject tells in between; other lines are messages of valgrind.
    pub(crate) fn read(text: impl BufRead) -> BenchResult<Self> {
        let (mut trace, mut marks, mut current) = (Self::default(), u64::MAX, None);
        for line in text.lines() {
            let line = line?;
            if let Some((kind, address, size)) = access(&line) {
                let mark = address.checked_sub(marks).map(|offset| (offset / 8) as usize);
                if let Some(step) = mark.filter(|step| kind == Kind::Store && *step <= STEPS.len()) {
                    if step == 0 {
                        trace.samples.push(Vec::new());
                    }
                    current = Some(step).filter(|step| *step < STEPS.len());
                } else if let (Some(step), Some(sample)) = (current, trace.samples.last_mut()) {
                    sample.push(Access { step, kind, address, size });
                }
            } else if let Some((marked, base)) = line.strip_prefix("marks ").and_then(|rest| rest.split_once(' ')) {
                (marks, trace.base) = (u64::from_str_radix(marked, 16)?, u64::from_str_radix(base, 16)?);
            }
        }
        Ok(trace)
    }

    /// The lines of each step, before and after it has submitted a sample.
    pub(crate) fn count(&self, sources: &HashMap<u64, Source>) -> BTreeMap<(usize, bool), Lines> {
        let (mut counts, other) = (BTreeMap::<_, Lines>::new(), (Owner::Other, String::new()));
        for sample in &self.samples {
            // A copy by the C library touches its caller's data.
            let (mut executed, mut caller) = (&other, &other);
            let (mut owners, mut submitted) = (Vec::new(), [usize::MAX; STEPS.len()]);
            for (index, access) in sample.iter().enumerate() {
                if access.kind == Kind::Instruction {
                    executed = sources.get(&access.address).unwrap_or(&other);
                    caller = if executed.0 == Owner::Other { caller } else { executed };
                } else if access.kind == Kind::Store && executed.1 == SUBMITS {
                    submitted[access.step] = index;
                }
                owners.push(if access.kind == Kind::Instruction { executed.0 } else { caller.0 });
            }
            let (mut warm, mut seen) = (HashSet::new(), HashSet::new());
            for (index, (access, owner)) in sample.iter().zip(owners).enumerate() {
                let code = usize::from(access.kind == Kind::Instruction);
                for line in access.address >> LINE_BITS..=(access.address + access.size.max(1) - 1) >> LINE_BITS {
                    let line = (STEPS[access.step].0, code, line);
                    if access.step < WARMING {
                        warm.insert(line);
                    } else if seen.insert(line) {
                        let lines = counts.entry((access.step, index > submitted[access.step])).or_default();
                        lines.touched[code][owner as usize] += 1;
                        lines.cold[code] += usize::from(!warm.contains(&line));
                    }
                }
            }
        }
        counts
    }
}

/// An access in a line of the trace: kind, address and size.
fn access(line: &str) -> Option<(Kind, u64, u64)> {
    let (kind, rest) = line.split_at_checked(3)?;
    let kind = match kind {
        "I  " => Kind::Instruction,
        " S " => Kind::Store,
        " L " | " M " => Kind::Load,
        _ => return None,
    };
    let (address, size) = rest.split_once(',')?;
    Some((kind, u64::from_str_radix(address, 16).ok()?, size.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_counted_once_by_step_owner_and_warmth() {
        // Step 0 is the worker's, 1 and 3 are the client's: what the worker has touched is cold for it.
        let text = "==7== Lackey\nmarks 1000 400000\nI  400000,4\n S 9000,8\n S 1000,8\nI  400040,4\n L 9000,8\n S 1008,8\n L 9100,8
 S 1018,8\nI  400040,4\n L 9000,8\nI  40007e,4\n M 903c,8\n S 9100,8\nI  400100,4\n L 9200,8\n S 1040,8\n L 9300,8\n";
        let trace = Trace::read(text.as_bytes()).unwrap();
        assert_eq!((trace.samples.len(), trace.samples[0].len(), trace.base), (1, 10, 0x40_0000));
        let queue = (Owner::Iceoryx2, SUBMITS.to_owned());
        let sources = [(0x40_0040, (Owner::Isotherm, "a.rs".to_owned())), (0x40_007e, queue)];
        // The instruction at 40007e and its load extend into a second line; its store, to a warm line, submits.
        let before = Lines { touched: [[1, 2, 0], [1, 1, 0]], cold: [2, 2] };
        let after = Lines { touched: [[0, 1, 0], [0, 0, 1]], cold: [1, 1] };
        assert_eq!(trace.count(&sources.into_iter().collect()), [((3, false), before), ((3, true), after)].into());
    }
}
