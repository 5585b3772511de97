//! Atomics with shadows: within [`explore`] each stands for one of loom's, which is found by its address. So they are
//! as large as the standard ones, exist in statics and in mapped memory, and are the standard ones everywhere else.

use core::panic::Location;
use core::sync::atomic::{self, Ordering};
use loom::model::Builder;
use loom::sync::atomic as loomed;
use std::any::Any;
use std::cell::RefCell;
use std::collections::{BTreeSet, HashMap};
use std::panic::{AssertUnwindSafe, catch_unwind, panic_any, resume_unwind};
use std::rc::Rc;
use std::sync::Arc;

/// A place in the code where an ordering stands.
type Site = &'static Location<'static>;

/// What an exploration knows. loom runs all threads of a model in one thread of the operating system.
#[derive(Default)]
struct World {
    /// Made before the model's threads, because loom takes the making of an atomic for a write to it.
    spare: Vec<Shadow>,
    shadows: HashMap<usize, Shadow>,
    /// Where orderings stronger than `Relaxed` were met.
    sites: BTreeSet<Site>,
    weakened: Option<Site>,
    executions: u64,
}

/// What stands for an atomic or a cell. The atomic has the difference from the real atomic's value, so that all begin
/// with 0.
type Shadow = Rc<(loomed::AtomicU64, loom::cell::UnsafeCell<()>)>;

/// The panic of a model that has more atomics than there are shadows.
const TOO_FEW: &str = "too few shadows";

thread_local! {
    static WORLD: RefCell<Option<World>> = const { RefCell::new(None) };
}

/// What was explored.
#[derive(Debug)]
pub struct Exploration {
    /// Executions: orders of operations with the values that loads gave.
    pub executions: u64,
    /// Orderings that are needed: each was weakened to `Relaxed`, and a fault was found.
    pub needed: Vec<String>,
    /// Orderings that this model does not need.
    pub idle: Vec<String>,
}

/// Explores all executions of `model`, then all with one ordering weakened, for each that was met.
///
/// # Panics
/// If an execution of `model` panics or has a data race.
pub fn explore(model: impl Fn() + Send + Sync + 'static) -> Exploration {
    let model = Arc::new(model);
    let (result, world) = check(Arc::clone(&model), None);
    if let Err(fault) = result {
        resume_unwind(fault);
    }
    let mut exploration = Exploration { executions: world.executions, needed: Vec::new(), idle: Vec::new() };
    for site in &world.sites {
        let (result, _) = check(Arc::clone(&model), Some(site));
        let list = if result.is_err() { &mut exploration.needed } else { &mut exploration.idle };
        list.push(format!("{}:{}", site.file(), site.line()));
        let text = result.err().and_then(|fault| fault.downcast::<String>().ok()).unwrap_or_default();
        assert!(!text.contains("exceeded maximum"), "{site}: {text}");
    }
    println!("{exploration:?}");
    exploration
}

fn check(
    model: Arc<impl Fn() + Send + Sync + 'static>,
    weakened: Option<Site>,
) -> (Result<(), Box<dyn Any + Send>>, World) {
    let mut shadows = 8;
    loop {
        WORLD.set(Some(World { weakened, ..World::default() }));
        let mut builder = Builder::new();
        builder.max_branches = 100_000;
        let model = Arc::clone(&model);
        let result = catch_unwind(AssertUnwindSafe(|| {
            builder.check(move || {
                let spare = (0..shadows).map(|_| Shadow::default()).collect();
                // Memory of the last execution is used again.
                within(|world| {
                    world.shadows.clear();
                    world.spare = spare;
                    world.executions += 1;
                });
                model();
            });
        }));
        let world = WORLD.take().unwrap_or_default();
        match &result {
            Err(fault) if fault.downcast_ref::<&str>() == Some(&TOO_FEW) => shadows *= 2,
            _ => return (result, world),
        }
    }
}

/// Looks at the world, if this is an exploration. Nothing of loom is called meanwhile: it would go on with another
/// thread of the model.
fn within<R>(look: impl FnOnce(&mut World) -> R) -> Option<R> {
    WORLD.with_borrow_mut(|world| world.as_mut().map(look))
}

/// The shadow of what is at this address; `None` outside of an exploration.
fn shadow(address: usize) -> Option<Shadow> {
    let shadow = within(|world| {
        let known = world.shadows.get(&address).cloned();
        known.or_else(|| {
            let fresh = world.spare.pop()?;
            Some(Rc::clone(world.shadows.entry(address).or_insert(fresh)))
        })
    })?;
    Some(shadow.unwrap_or_else(|| panic_any(TOO_FEW)))
}

/// Notes where an ordering stands, and weakens it if it is its turn.
#[track_caller]
fn met(ordering: Ordering) -> Ordering {
    let site = Location::caller();
    let weakened = within(|world| {
        if ordering != Ordering::Relaxed {
            world.sites.insert(site);
        }
        world.weakened == Some(site)
    });
    if weakened == Some(true) { Ordering::Relaxed } else { ordering }
}

macro_rules! atomic {
    ($name:ident, $value:ty, $from:expr) => {
        /// The standard atomic of this name; within an exploration, its shadow.
        #[derive(Debug, Default)]
        #[repr(transparent)]
        pub struct $name(atomic::$name);

        impl $name {
            /// An atomic with this value.
            pub const fn new(value: $value) -> Self {
                Self(atomic::$name::new(value))
            }

            fn shadow(&self) -> Option<(Shadow, u64)> {
                let shadow = shadow(core::ptr::from_ref(self).addr())?;
                Some((shadow, self.0.load(Ordering::Relaxed).into()))
            }

            /// As of the standard atomic.
            #[track_caller]
            pub fn load(&self, ordering: Ordering) -> $value {
                match self.shadow() {
                    Some((shadow, first)) => $from(shadow.0.load(met(ordering)).wrapping_add(first)),
                    None => self.0.load(ordering),
                }
            }

            /// As of the standard atomic.
            #[track_caller]
            pub fn store(&self, value: $value, ordering: Ordering) {
                match self.shadow() {
                    Some((shadow, first)) => shadow.0.store(u64::from(value).wrapping_sub(first), met(ordering)),
                    None => self.0.store(value, ordering),
                }
            }

            /// As of the standard atomic. Where it succeeds the first ordering counts, and that one is weakened.
            #[track_caller]
            pub fn compare_exchange(
                &self,
                current: $value,
                new: $value,
                success: Ordering,
                failure: Ordering,
            ) -> Result<$value, $value> {
                let Some((shadow, first)) = self.shadow() else {
                    return self.0.compare_exchange(current, new, success, failure);
                };
                let [current, new] = [current, new].map(|value| u64::from(value).wrapping_sub(first));
                let found = |value: u64| $from(value.wrapping_add(first));
                shadow.0.compare_exchange(current, new, met(success), failure).map(found).map_err(found)
            }
        }
    };
}

atomic!(AtomicU64, u64, u64::from);
atomic!(AtomicU8, u8, |value: u64| value as u8);
atomic!(AtomicBool, bool, |value: u64| value != 0);

impl AtomicU64 {
    /// As of the standard atomic.
    #[track_caller]
    pub fn fetch_add(&self, value: u64, ordering: Ordering) -> u64 {
        match self.shadow() {
            Some((shadow, first)) => shadow.0.fetch_add(value, met(ordering)).wrapping_add(first),
            None => self.0.fetch_add(value, ordering),
        }
    }
}

/// The standard cell of this name. Within an exploration, two threads that get its content without an order between
/// them are a data race.
#[derive(Debug, Default)]
#[repr(transparent)]
pub struct UnsafeCell<T: ?Sized>(core::cell::UnsafeCell<T>);

impl<T> UnsafeCell<T> {
    /// A cell with this content.
    pub const fn new(content: T) -> Self {
        Self(core::cell::UnsafeCell::new(content))
    }

    /// The content, to be changed.
    #[track_caller]
    pub fn get(&self) -> *mut T {
        if let Some(shadow) = shadow(core::ptr::from_ref(self).addr()) {
            shadow.1.with_mut(|_| ());
        }
        self.0.get()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Ordering::{Acquire, Relaxed, Release};
    use loom::thread;

    /// A value, and a flag that announces it.
    fn hand_over(store: Ordering, load: Ordering) {
        let shared = Arc::new((AtomicU64::new(0), AtomicBool::new(false)));
        let writer = {
            let shared = Arc::clone(&shared);
            thread::spawn(move || {
                shared.0.store(7, Relaxed);
                shared.1.store(true, store);
            })
        };
        if shared.1.load(load) {
            assert_eq!(shared.0.load(Relaxed), 7);
        }
        writer.join().unwrap();
    }

    #[test]
    fn explored_orderings_that_are_needed_are_found() {
        let exploration = explore(|| hand_over(Release, Acquire));
        assert_eq!((exploration.needed.len(), exploration.idle.len()), (2, 0), "{exploration:?}");
        assert!(exploration.executions > 2);
    }

    #[test]
    #[should_panic(expected = "assertion")]
    fn explored_faults_are_found() {
        explore(|| hand_over(Relaxed, Acquire));
    }

    #[test]
    fn explored_orderings_that_nothing_needs_are_told_apart() {
        let exploration = explore(|| {
            let shared = Arc::new(AtomicU64::new(0));
            let writer = {
                let shared = Arc::clone(&shared);
                thread::spawn(move || shared.store(7, Release))
            };
            writer.join().unwrap();
            assert_eq!(shared.load(Relaxed), 7);
        });
        assert_eq!((exploration.needed.len(), exploration.idle.len()), (0, 1), "{exploration:?}");
    }

    #[test]
    #[should_panic(expected = "oncurrent")]
    fn explored_races_on_a_cell_are_found() {
        explore(|| {
            let shared = Arc::new((UnsafeCell::new(0), AtomicU8::new(0)));
            let other = {
                let shared = Arc::clone(&shared);
                thread::spawn(move || _ = shared.0.get())
            };
            shared.0.get();
            other.join().unwrap();
        });
    }

    #[test]
    fn explored_atomics_are_the_standard_ones_elsewhere() {
        let number = AtomicU64::new(3);
        assert_eq!((number.fetch_add(2, Relaxed), number.load(Acquire)), (3, 5));
        assert_eq!(number.compare_exchange(3, 1, Acquire, Relaxed), Err(5));
    }
}
