//! A reference-counted value whose memory the next value reuses.
//!
//! The transport keeps its state of a loaned sample behind a reference count, one for each loan. With
//! [`Rc`](std::rc::Rc) that is one allocation for each sample. Here the memory of a sample that was sent is reused for
//! the next loan, so that a running system allocates nothing.
//!
//! Like `Rc` it is neither `Send` nor `Sync`. Each thread has its own list of at most 64 free blocks, which
//! begins full: how many samples are in use at once depends on how busy the machine is, and none of them allocates.
#![expect(unsafe_code, reason = "no safe reference count lets its memory be chosen")]

use core::cell::{Cell, RefCell};
use core::fmt;
use core::marker::PhantomData;
use core::ops::Deref;
use core::ptr::NonNull;
use iceoryx2_bb_elementary_traits::testing::abandonable::Abandonable;
use iceoryx2_cal::arc_sync_policy::{ArcSyncPolicy, ArcSyncPolicyCreationError, LockGuard};
use std::alloc::{Layout, alloc, dealloc, handle_alloc_error};

/// Free blocks that a thread keeps at most; more than the samples that are ever loaned at once.
const MAX_FREE: usize = 64;

/// Layout of a recycled block. The state of a loaned sample fits (5 words). A larger value, such as a port's state, is
/// not recycled: it is made once.
const BLOCK: Layout = Layout::new::<[u64; 8]>();

/// A value shared by its holders within one thread.
pub struct RecycledRc<T> {
    counted: NonNull<CountedValue<T>>,
    _owns: PhantomData<CountedValue<T>>,
}

struct CountedValue<T> {
    holders: Cell<usize>,
    value: T,
}

impl<T> RecycledRc<T> {
    /// The first holder of `value`.
    pub fn new(value: T) -> Self {
        let counted: NonNull<CountedValue<T>> = allocate(Layout::new::<CountedValue<T>>()).cast();
        // SAFETY: `allocate` gave memory of this layout that nothing else uses.
        unsafe { counted.write(CountedValue { holders: Cell::new(1), value }) };
        Self { counted, _owns: PhantomData }
    }

    fn counted(&self) -> &CountedValue<T> {
        // SAFETY: initialized by `new` and released only by the last holder's drop; `self` is a holder.
        unsafe { self.counted.as_ref() }
    }
}

impl<T> Deref for RecycledRc<T> {
    type Target = T;
    fn deref(&self) -> &T {
        &self.counted().value
    }
}

impl<T> Clone for RecycledRc<T> {
    fn clone(&self) -> Self {
        let holders = &self.counted().holders;
        // Every holder takes memory, so the count can reach its maximum only if holders are leaked. It stays there, and
        // the value is never dropped.
        holders.set(holders.get().saturating_add(1));
        Self { counted: self.counted, _owns: PhantomData }
    }
}

impl<T> Drop for RecycledRc<T> {
    fn drop(&mut self) {
        let holders = &self.counted().holders;
        match holders.get() {
            1 => {
                // SAFETY: this is the last holder, so nothing else uses the value or its memory.
                unsafe { self.counted.drop_in_place() };
                release(self.counted.cast(), Layout::new::<CountedValue<T>>());
            }
            usize::MAX => {}
            more => holders.set(more - 1),
        }
    }
}

impl<T: fmt::Debug> fmt::Debug for RecycledRc<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}

/// Access to the value while a holder is borrowed. Nothing is locked, because all holders are in one thread.
pub struct RecycledGuard<'a, T>(&'a T);

impl<T> Deref for RecycledGuard<'_, T> {
    type Target = T;
    fn deref(&self) -> &T {
        self.0
    }
}

impl<'a, T: Send + fmt::Debug + Abandonable> LockGuard<'a, T> for RecycledGuard<'a, T> {}

impl<T: Send + fmt::Debug + Abandonable> ArcSyncPolicy<T> for RecycledRc<T> {
    type LockGuard<'a>
        = RecycledGuard<'a, T>
    where
        Self: 'a,
        T: 'a;

    fn new(value: T) -> Result<Self, ArcSyncPolicyCreationError> {
        Ok(Self::new(value))
    }

    fn lock(&self) -> RecycledGuard<'_, T> {
        RecycledGuard(self)
    }
}

impl<T: Abandonable> Abandonable for RecycledRc<T> {
    // Used by the transport's own crash tests, which simulate the death of a process: the value's drop does not run.
    unsafe fn abandon_in_place(mut this: NonNull<Self>) {
        // SAFETY: by the caller's contract `this` is a live holder that nobody uses afterwards.
        let this = unsafe { this.as_mut() };
        let holders = &this.counted().holders;
        if holders.get() == 1 {
            // SAFETY: this is the last holder; the value is abandoned once, and its memory stays allocated.
            unsafe { T::abandon_in_place(NonNull::from(&mut this.counted.as_mut().value)) };
        } else {
            holders.set(holders.get().saturating_sub(1));
        }
    }
}

/// The free blocks of a thread, all with [`BLOCK`]'s layout.
struct FreeBlocks(Vec<NonNull<u8>>);

impl Drop for FreeBlocks {
    fn drop(&mut self) {
        for block in self.0.drain(..) {
            // SAFETY: `allocate` allocated it with this layout, and a block in the list is not in use.
            unsafe { dealloc(block.as_ptr(), BLOCK) };
        }
    }
}

thread_local! {
    static FREE: RefCell<FreeBlocks> = RefCell::new(FreeBlocks((0..MAX_FREE).map(|_| fresh(BLOCK)).collect()));
}

/// The layout to allocate: [`BLOCK`] where `layout` fits into it.
const fn rounded(layout: Layout) -> Layout {
    if layout.size() <= BLOCK.size() && layout.align() <= BLOCK.align() { BLOCK } else { layout }
}

fn allocate(layout: Layout) -> NonNull<u8> {
    let layout = rounded(layout);
    // The list may have been destroyed already while the thread ends.
    let free = if layout == BLOCK { FREE.try_with(|free| free.borrow_mut().0.pop()).ok().flatten() } else { None };
    free.unwrap_or_else(|| fresh(layout))
}

/// New memory of a layout that has room for a count at least.
fn fresh(layout: Layout) -> NonNull<u8> {
    // SAFETY: the layout is not empty.
    NonNull::new(unsafe { alloc(layout) }).unwrap_or_else(|| handle_alloc_error(layout))
}

fn release(block: NonNull<u8>, layout: Layout) {
    let layout = rounded(layout);
    let keep = |free: &RefCell<FreeBlocks>| {
        let free = &mut free.borrow_mut().0;
        let room = free.len() < MAX_FREE;
        if room {
            free.push(block);
        }
        room
    };
    if layout != BLOCK || !FREE.try_with(keep).unwrap_or(false) {
        // SAFETY: `allocate` allocated it with the same layout, and nothing uses it any more.
        unsafe { dealloc(block.as_ptr(), layout) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::rc::Rc;

    /// Counts its drops.
    #[derive(Debug)]
    struct DropCounter(Rc<Cell<u32>>, [u64; 2]);

    impl Drop for DropCounter {
        fn drop(&mut self) {
            self.0.set(self.0.get() + 1);
        }
    }

    #[test]
    fn dropped_once_by_the_last_holder() {
        let drops = Rc::new(Cell::new(0));
        let first = RecycledRc::new(DropCounter(Rc::clone(&drops), [1, 2]));
        let second = first.clone();
        drop(first);
        assert_eq!((drops.get(), second.1), (0, [1, 2]));
        drop(second);
        assert_eq!(drops.get(), 1);
    }

    #[test]
    fn memory_is_used_again_but_never_twice_at_once() {
        let first = RecycledRc::new([7_u64; 4]);
        let address = first.counted.as_ptr().cast::<u8>();
        drop(first);
        let (again, other) = (RecycledRc::new([8_u64; 2]), RecycledRc::new([9_u64; 2]));
        assert_eq!(again.counted.as_ptr().cast::<u8>(), address);
        assert_ne!(other.counted.as_ptr().cast::<u8>(), address);
        assert_eq!((*again, *other), ([8; 2], [9; 2]));
    }

    #[test]
    fn large_and_many_values_work_too() {
        let drops = Rc::new(Cell::new(0));
        let many: Vec<_> =
            (0..3 * MAX_FREE as u64).map(|k| RecycledRc::new(DropCounter(Rc::clone(&drops), [k, !k]))).collect();
        assert!(many.iter().zip(0..).all(|(held, k)| held.1 == [k, !k]));
        drop(many);
        assert_eq!(drops.get(), 3 * MAX_FREE as u32);
        assert!(FREE.with(|free| free.borrow().0.len()) <= MAX_FREE);
        let large = RecycledRc::new([5_u8; 4096]);
        assert!(large.clone().iter().all(|byte| *byte == 5));
    }

    #[test]
    fn values_may_outlive_the_list_of_their_thread() {
        thread_local! {
            static LATE: RefCell<Option<RecycledRc<u64>>> = const { RefCell::new(None) };
        }
        // Either thread-local may be destroyed first; nothing is freed twice or used after it was freed.
        for order in [true, false] {
            std::thread::spawn(move || {
                if order {
                    LATE.with(|late| late.borrow_mut().take());
                }
                let held = RecycledRc::new(3);
                LATE.with(|late| *late.borrow_mut() = Some(held));
            })
            .join()
            .unwrap();
        }
    }
}
