//! The helper thread of a handle: it does what may wait, so that no call of the handle's user does.
//!
//! It sleeps until it is asked. The user's thread never waits for it: it only tries the lock of the place where
//! questions and answers lie.
#![expect(
    unsafe_code,
    reason = "signal masks and scheduling policies have no safe binding; ports go from one thread to another as a whole"
)]

use crate::process::Process;
use core::mem::{self, ManuallyDrop, MaybeUninit};
use core::sync::atomic::{AtomicBool, Ordering};
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::{io, ptr};

/// Stack of the thread \[bytes\], which a process with locked memory has in full. Joining reads TOML, which takes more
/// than 512 KiB where nothing is optimized.
const STACK: usize = 2 * 1024 * 1024;

/// The helper thread, which answers questions `Q` by `A`, one at a time.
#[derive(Debug)]
pub(crate) struct Helper<Q, A> {
    asked: Asked<Q>,
    desk: Arc<Desk<Q, A>>,
    thread: Option<JoinHandle<()>>,
    process: Process,
}

/// What the thread has been asked for.
#[derive(Debug)]
enum Asked<Q> {
    Nothing,
    /// This, which it could not be given yet.
    NotYet(Q),
    /// Something that it has not answered yet.
    Something,
}

/// Where question and answer lie.
#[derive(Debug)]
struct Desk<Q, A> {
    papers: Mutex<(Option<Q>, Option<A>)>,
    is_answered: AtomicBool,
    is_closing: AtomicBool,
}

impl<Q: Send + 'static, A: Send + 'static> Helper<Q, A> {
    /// Starts the thread. `answer` also gets a function that says whether the handle is closing: nobody waits for the
    /// answer then.
    ///
    /// # Errors
    /// The operating system's.
    pub(crate) fn start(mut answer: impl FnMut(Q, &dyn Fn() -> bool) -> A + Send + 'static) -> io::Result<Self> {
        let desk = Arc::new(Desk {
            papers: Mutex::new((None, None)),
            is_answered: AtomicBool::new(false),
            is_closing: AtomicBool::new(false),
        });
        let at_desk = Arc::clone(&desk);
        let work = move || {
            leave_realtime();
            let is_closing = || at_desk.is_closing.load(Ordering::Acquire);
            while !is_closing() {
                let question = at_desk.papers.lock().unwrap_or_else(PoisonError::into_inner).0.take();
                let Some(question) = question else {
                    thread::park();
                    continue;
                };
                // A panic, whose message is on stderr, leaves the question without an answer.
                let answered = catch_unwind(AssertUnwindSafe(|| answer(question, &is_closing)));
                at_desk.papers.lock().unwrap_or_else(PoisonError::into_inner).1 = answered.ok();
                at_desk.is_answered.store(true, Ordering::Release);
            }
        };
        let builder = thread::Builder::new().name("isotherm-helper".to_owned()).stack_size(STACK);
        let thread = with_signals_blocked(|| builder.spawn(work))?;
        Ok(Self { asked: Asked::Nothing, desk, thread: Some(thread), process: Process::current() })
    }

    /// Whether the last question has been answered, so that another one may be asked.
    pub(crate) const fn is_free(&self) -> bool {
        matches!(self.asked, Asked::Nothing)
    }

    /// Asks, if it [is free](Self::is_free).
    pub(crate) fn ask(&mut self, question: Q) {
        self.asked = match self.desk.papers.try_lock() {
            Ok(mut papers) => {
                papers.0 = Some(question);
                Asked::Something
            }
            // The thread is at the desk just now. The next look for the answer asks again.
            Err(_) => Asked::NotYet(question),
        };
        self.thread.iter().for_each(|thread| thread.thread().unpark());
    }

    /// The answer, once, if it is there. A question whose answer has panicked has none, and another one may be asked.
    pub(crate) fn answer(&mut self) -> Option<A> {
        match mem::replace(&mut self.asked, Asked::Nothing) {
            Asked::Nothing => return None,
            Asked::NotYet(question) => {
                self.ask(question);
                return None;
            }
            Asked::Something => self.asked = Asked::Something,
        }
        if !self.desk.is_answered.load(Ordering::Acquire) {
            return None;
        }
        let answer = self.desk.papers.try_lock().ok()?.1.take();
        self.desk.is_answered.store(false, Ordering::Relaxed);
        self.asked = Asked::Nothing;
        answer
    }
}

impl<Q, A> Drop for Helper<Q, A> {
    /// Waits for the end of the thread, so that nothing is left half-created.
    fn drop(&mut self) {
        let Some(thread) = self.thread.take() else { return };
        if !self.process.is_current() {
            // A child of a fork has no such thread, and no part in what waits for it.
            let _ = ManuallyDrop::new((thread, mem::replace(&mut self.asked, Asked::Nothing)));
            return;
        }
        self.desk.is_closing.store(true, Ordering::Release);
        thread.thread().unpark();
        // If it has panicked, its message is on stderr.
        let _ = thread.join();
    }
}

/// All ports of a handle, with their node, on their way to another thread.
#[derive(Debug)]
pub(crate) struct MovedPorts<P>(Box<P>);

// SAFETY: the ports are not `Send` only because they and their node share counts that are not atomic (`RecycledRc`,
// `Rc`). Whoever calls `new` sees to it that all holders of such a count are within the ports, so they change threads
// together.
unsafe impl<P> Send for MovedPorts<P> {}

impl<P> MovedPorts<P> {
    /// These ports, of which nothing is on loan.
    pub(crate) fn new(ports: P) -> Self {
        Self(Box::new(ports))
    }

    pub(crate) fn take(self) -> P {
        *self.0
    }
}

/// Calls `work` with all signals blocked: a thread that it starts inherits that, so that every signal goes to a thread
/// of the program.
fn with_signals_blocked<T>(work: impl FnOnce() -> T) -> T {
    let (mut all, mut before) = (MaybeUninit::uninit(), MaybeUninit::uninit());
    // SAFETY: the first call fills `all` and cannot fail; the second reads it and fills `before`.
    let is_blocked = unsafe {
        libc::sigfillset(all.as_mut_ptr());
        libc::pthread_sigmask(libc::SIG_SETMASK, all.as_ptr(), before.as_mut_ptr()) == 0
    };
    let result = work();
    if is_blocked {
        // SAFETY: filled by the call above.
        let _ = unsafe { libc::pthread_sigmask(libc::SIG_SETMASK, before.as_ptr(), ptr::null_mut()) };
    }
    result
}

/// Takes the calling thread out of what it has inherited from a real-time thread: its policy, and its cores if there
/// are others, which such a thread may occupy.
fn leave_realtime() {
    let parameters = libc::sched_param { sched_priority: 0 };
    // SAFETY: a system call on the calling thread (0) that reads one structure, which is valid during the call.
    let _ = unsafe { libc::sched_setscheduler(0, libc::SCHED_OTHER, &raw const parameters) };
    let Ok(inherited) = sched_getaffinity(None) else { return };
    let mut others = CpuSet::new();
    (0..CpuSet::MAX_CPU).filter(|core| !inherited.is_set(*core)).for_each(|core| others.set(core));
    if inherited.count() == 1 {
        // Where there is no other core that may be used, the kernel refuses it.
        let _ = sched_setaffinity(None, &others);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn answer<A: Send + 'static>(helper: &mut Helper<u64, A>, question: u64) -> A {
        helper.ask(question);
        loop {
            if let Some(answer) = helper.answer() {
                return answer;
            }
            thread::yield_now();
        }
    }

    #[test]
    fn each_question_has_one_answer() {
        let mut sum = 0;
        let mut helper = Helper::start(move |question: u64, _: &dyn Fn() -> bool| {
            sum += question;
            sum
        })
        .unwrap();
        for (question, expected) in [(1, 1), (2, 3), (3, 6)] {
            assert_eq!(answer(&mut helper, question), expected);
            assert!(helper.is_free() && helper.answer().is_none());
        }
    }

    #[test]
    fn a_panic_leaves_room_for_the_next_question() {
        let mut helper = Helper::start(|question: u64, _: &dyn Fn() -> bool| {
            assert_ne!(question, 1, "on purpose");
            question
        })
        .unwrap();
        helper.ask(1);
        while !helper.is_free() {
            assert_eq!(helper.answer(), None);
            thread::yield_now();
        }
        assert_eq!(answer(&mut helper, 2), 2);
    }

    #[test]
    fn closing_ends_what_is_under_way() {
        let mut helper = Helper::start(|_: u64, is_closing: &dyn Fn() -> bool| {
            while !is_closing() {
                thread::yield_now();
            }
        })
        .unwrap();
        helper.ask(1);
        drop(helper);
    }

    #[test]
    fn it_takes_no_signals_and_leaves_the_core_of_its_handle() {
        let cores = || {
            let status = fs::read_to_string("/proc/thread-self/status").unwrap();
            let line = |name: &str| status.lines().find_map(|line| line.strip_prefix(name)).unwrap().trim().to_owned();
            (line("SigBlk:"), line("Cpus_allowed_list:"))
        };
        let all = cores().1;
        let bound = thread::spawn(move || {
            crate::Realtime { core: Some(0), ..crate::Realtime::default() }.apply().unwrap();
            let mut helper = Helper::start(move |_: u64, _: &dyn Fn() -> bool| cores()).unwrap();
            (answer(&mut helper, 1), cores())
        });
        let ((blocked, helpers), (own_blocked, own)) = bound.join().unwrap();
        // All but those that cannot be blocked: the two of the kernel, and the two of the C library.
        assert_eq!(u64::from_str_radix(&blocked, 16).unwrap() | 1 << 8 | 1 << 18 | 3 << 31, u64::MAX, "{blocked}");
        assert_eq!(u64::from_str_radix(&own_blocked, 16).unwrap(), 0);
        assert_eq!(own, "0");
        assert_eq!(helpers == own, all == own, "{helpers} {all}");
    }
}
