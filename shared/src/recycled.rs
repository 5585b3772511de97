//! A reference-counted value whose memory is used again by the next one.
//!
//! The transport keeps what it knows of a loaned sample behind a reference count, one for each loan. With
//! [`Rc`](std::rc::Rc) that is one allocation a sample for as long as samples flow; here the memory of the sample that
//! was sent last serves the one that is loaned next, so that a running system allocates nothing.
//!
//! Not `Send`, not `Sync`, like `Rc`. The freed blocks are a list of the thread's own, at most 64 of them.
#![expect(unsafe_code, reason = "no safe reference count lets its memory be chosen")]

use core::cell::{Cell, RefCell};
use core::fmt;
use core::marker::PhantomData;
use core::ops::Deref;
use core::ptr::NonNull;
use iceoryx2_bb_elementary_traits::testing::abandonable::Abandonable;
use iceoryx2_cal::arc_sync_policy::{ArcSyncPolicy, ArcSyncPolicyCreationError, LockGuard};
use std::alloc::{Layout, alloc, dealloc, handle_alloc_error};

/// Blocks that a thread keeps for later; more than samples are ever loaned at once.
const KEPT: usize = 64;

/// What fits into this is recycled: the state of a loaned sample (5 words). Anything else, a port's state, is made once.
const BLOCK: Layout = Layout::new::<[u64; 8]>();

/// A value shared by its holders within one thread.
pub struct Recycled<T> {
    place: NonNull<Place<T>>,
    _owns: PhantomData<Place<T>>,
}

struct Place<T> {
    holders: Cell<usize>,
    value: T,
}

impl<T> Recycled<T> {
    /// Takes `value` in.
    pub fn new(value: T) -> Self {
        let place: NonNull<Place<T>> = take(Layout::new::<Place<T>>()).cast();
        // SAFETY: `take` gave memory of this layout that nothing else uses.
        unsafe { place.write(Place { holders: Cell::new(1), value }) };
        Self { place, _owns: PhantomData }
    }

    fn place(&self) -> &Place<T> {
        // SAFETY: initialized by `new` and given back only by the last holder's drop; `self` is a holder.
        unsafe { self.place.as_ref() }
    }
}

impl<T> Deref for Recycled<T> {
    type Target = T;
    fn deref(&self) -> &T {
        &self.place().value
    }
}

impl<T> Clone for Recycled<T> {
    fn clone(&self) -> Self {
        let holders = &self.place().holders;
        // Every holder takes memory, so the count cannot wrap unless holders are leaked; then it stops at the top, and
        // the value is never dropped.
        holders.set(holders.get().saturating_add(1));
        Self { place: self.place, _owns: PhantomData }
    }
}

impl<T> Drop for Recycled<T> {
    fn drop(&mut self) {
        let holders = &self.place().holders;
        match holders.get() {
            1 => {
                // SAFETY: the last holder; nobody uses value or memory any more.
                unsafe { self.place.drop_in_place() };
                give(self.place.cast(), Layout::new::<Place<T>>());
            }
            usize::MAX => {}
            more => holders.set(more - 1),
        }
    }
}

impl<T: fmt::Debug> fmt::Debug for Recycled<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}

/// Access for as long as the holder is borrowed; there is nothing to lock within one thread.
pub struct Guard<'a, T>(&'a T);

impl<T> Deref for Guard<'_, T> {
    type Target = T;
    fn deref(&self) -> &T {
        self.0
    }
}

impl<'a, T: Send + fmt::Debug + Abandonable> LockGuard<'a, T> for Guard<'a, T> {}

impl<T: Send + fmt::Debug + Abandonable> ArcSyncPolicy<T> for Recycled<T> {
    type LockGuard<'a>
        = Guard<'a, T>
    where
        Self: 'a,
        T: 'a;

    fn new(value: T) -> Result<Self, ArcSyncPolicyCreationError> {
        Ok(Self::new(value))
    }

    fn lock(&self) -> Guard<'_, T> {
        Guard(self)
    }
}

impl<T: Abandonable> Abandonable for Recycled<T> {
    // For the transport's own crash tests: as if the process had died, the value's drop does not run.
    unsafe fn abandon_in_place(mut this: NonNull<Self>) {
        // SAFETY: by the caller's contract `this` is a live holder that nobody uses afterwards.
        let this = unsafe { this.as_mut() };
        let holders = &this.place().holders;
        if holders.get() == 1 {
            // SAFETY: the last holder; the value is abandoned once and its memory stays where it is.
            unsafe { T::abandon_in_place(NonNull::from(&mut this.place.as_mut().value)) };
        } else {
            holders.set(holders.get().saturating_sub(1));
        }
    }
}

/// The blocks that the thread has freed; all of [`BLOCK`]'s layout.
struct Free(Vec<NonNull<u8>>);

impl Drop for Free {
    fn drop(&mut self) {
        for block in self.0.drain(..) {
            // SAFETY: allocated by `take` with this layout, and in the list, so not in use.
            unsafe { dealloc(block.as_ptr(), BLOCK) };
        }
    }
}

thread_local! {
    static FREE: RefCell<Free> = RefCell::new(Free(Vec::with_capacity(KEPT)));
}

/// The layout that is really asked for.
const fn rounded(layout: Layout) -> Layout {
    if layout.size() <= BLOCK.size() && layout.align() <= BLOCK.align() { BLOCK } else { layout }
}

fn take(layout: Layout) -> NonNull<u8> {
    let layout = rounded(layout);
    // While a thread ends there is no list any more.
    let kept = if layout == BLOCK { FREE.try_with(|free| free.borrow_mut().0.pop()).ok().flatten() } else { None };
    kept.unwrap_or_else(|| {
        // SAFETY: no layout here is empty: each holds at least a count.
        NonNull::new(unsafe { alloc(layout) }).unwrap_or_else(|| handle_alloc_error(layout))
    })
}

fn give(block: NonNull<u8>, layout: Layout) {
    let layout = rounded(layout);
    let keep = |free: &RefCell<Free>| {
        let free = &mut free.borrow_mut().0;
        let room = free.len() < KEPT;
        if room {
            free.push(block);
        }
        room
    };
    if layout != BLOCK || !FREE.try_with(keep).unwrap_or(false) {
        // SAFETY: allocated by `take` with the same layout, and its last user is done.
        unsafe { dealloc(block.as_ptr(), layout) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::rc::Rc;

    /// Tells when it is dropped.
    #[derive(Debug)]
    struct Told(Rc<Cell<u32>>, [u64; 2]);

    impl Drop for Told {
        fn drop(&mut self) {
            self.0.set(self.0.get() + 1);
        }
    }

    #[test]
    fn dropped_once_by_the_last_holder() {
        let drops = Rc::new(Cell::new(0));
        let first = Recycled::new(Told(Rc::clone(&drops), [1, 2]));
        let second = first.clone();
        drop(first);
        assert_eq!((drops.get(), second.1), (0, [1, 2]));
        drop(second);
        assert_eq!(drops.get(), 1);
    }

    #[test]
    fn memory_is_used_again_but_never_twice_at_once() {
        let first = Recycled::new([7_u64; 4]);
        let address = first.place.as_ptr().cast::<u8>();
        drop(first);
        let (again, other) = (Recycled::new([8_u64; 2]), Recycled::new([9_u64; 2]));
        assert_eq!(again.place.as_ptr().cast::<u8>(), address);
        assert_ne!(other.place.as_ptr().cast::<u8>(), address);
        assert_eq!((*again, *other), ([8; 2], [9; 2]));
    }

    #[test]
    fn large_and_many_values_work_too() {
        let drops = Rc::new(Cell::new(0));
        let many: Vec<_> = (0..3 * KEPT as u64).map(|k| Recycled::new(Told(Rc::clone(&drops), [k, !k]))).collect();
        assert!(many.iter().zip(0..).all(|(held, k)| held.1 == [k, !k]));
        drop(many);
        assert_eq!(drops.get(), 3 * KEPT as u32);
        assert!(FREE.with(|free| free.borrow().0.len()) <= KEPT);
        let large = Recycled::new([5_u8; 4096]);
        assert!(large.clone().iter().all(|byte| *byte == 5));
    }

    #[test]
    fn values_may_outlive_the_list_of_their_thread() {
        thread_local! {
            static LATE: RefCell<Option<Recycled<u64>>> = const { RefCell::new(None) };
        }
        // Whichever of the two is destroyed first, nothing is freed twice or used after.
        for order in [true, false] {
            std::thread::spawn(move || {
                if order {
                    LATE.with(|late| late.borrow_mut().take());
                }
                let held = Recycled::new(3);
                LATE.with(|late| *late.borrow_mut() = Some(held));
            })
            .join()
            .unwrap();
        }
    }
}
