//! Shared memory of the transport that belongs to this process's user.
//!
//! iceoryx2 opens shared memory by its name, whoever made it: an object that another user puts in the place of a
//! connection would be taken for a queue, and an empty one would be waited for without limit. [`OwnStorage`] is
//! iceoryx2's storage in POSIX shared memory with two differences. It opens an object only if that is a regular file of
//! this user, and waits for its size no longer than the time-out. In `/dev/shm` nobody else can replace such an object,
//! because of the sticky bit. And a new object gets all its pages before anything is written to it: the kernel would
//! allocate a page when it is first touched, and end the process by SIGBUS if none is left. Names and contents are the
//! same, so processes that use iceoryx2's own storage take part in the same streams.
#![expect(unsafe_code, reason = "three functions of iceoryx2's traits are unsafe, and are passed on")]

use core::fmt::Debug;
use core::mem::MaybeUninit;
use core::ptr::NonNull;
use core::time::Duration;
use iceoryx2::prelude::{FileName, Path, ZeroCopySend};
use iceoryx2_bb_elementary_traits::testing::abandonable::Abandonable;
use iceoryx2_bb_memory::bump_allocator::BumpAllocator;
use iceoryx2_bb_posix::file::AccessMode;
use iceoryx2_cal::dynamic_storage::posix_shared_memory::{Builder, Configuration, Storage};
use iceoryx2_cal::dynamic_storage::{
    DynamicStorage, DynamicStorageBuilder, DynamicStorageCreateError, DynamicStorageOpenError,
    DynamicStorageOpenOrCreateError, Initializer,
};
use iceoryx2_cal::named_concept::{
    NamedConcept, NamedConceptBuilder, NamedConceptConfiguration as _, NamedConceptDoesExistError,
    NamedConceptListError, NamedConceptMgmt, NamedConceptPathHintRemoveError, NamedConceptRemoveError,
};
use rustix::fs::{FallocateFlags, OFlags, fallocate, statvfs};
use rustix::io::{Errno, retry_on_intr};
use std::cell::Cell;
use std::fs::File;
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _};
use std::time::Instant;
use std::{fs, io, thread};

/// Folder of the transport's shared memory.
pub const SHARED_MEMORY: &str = "/dev/shm";
/// What other processes may take while an object is created \[bytes\].
const SPARE: u64 = 64 << 10;

/// Pause between two looks at an object that has no size yet.
const PAUSE: Duration = Duration::from_millis(1);
/// An object that appears and vanishes so often while it is opened is given up.
const MAX_ATTEMPTS: u32 = 100;

/// iceoryx2's storage in POSIX shared memory, for objects of this user.
#[derive(Debug)]
pub struct OwnStorage<T: Debug + Send + Sync + ZeroCopySend> {
    storage: Storage<T>,
}

thread_local! {
    /// Size of the last object that this thread could not create because shared memory was full \[bytes\]; 0 for none.
    static REFUSED: Cell<u64> = const { Cell::new(0) };
}

/// Size of the last object that this thread could not create because shared memory was full \[bytes\]; 0 if there was
/// none. The transport's errors do not show it.
#[must_use]
pub fn refused_bytes() -> u64 {
    REFUSED.get()
}

/// Builder of [`OwnStorage`].
#[derive(Debug)]
pub struct OwnStorageBuilder<'builder, T: Debug + Send + Sync + ZeroCopySend> {
    name: FileName,
    config: Configuration<T>,
    supplementary_size: usize,
    has_ownership: bool,
    timeout: Duration,
    initializer: Initializer<'builder, T>,
}

/// What is in the place of an object.
enum Occupant {
    Nothing,
    /// A regular file of this user that has a size.
    Own,
    /// Anything else.
    Foreign,
}

impl<T: Debug + Send + Sync + ZeroCopySend + 'static> OwnStorageBuilder<'_, T> {
    fn path(&self) -> String {
        format!("{SHARED_MEMORY}/{}", self.config.path_for(&self.name).file_name())
    }

    /// Looks at the object without opening it. Waits for an own object that has no size yet.
    fn find(&self) -> Result<Occupant, DynamicStorageOpenError> {
        let path = self.path();
        let begun = Instant::now();
        loop {
            match fs::symlink_metadata(&path) {
                Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Occupant::Nothing),
                Err(_) => return Err(DynamicStorageOpenError::InternalError),
                Ok(found) if !found.is_file() => return Ok(Occupant::Foreign),
                Ok(found) if found.uid() == rustix::process::geteuid().as_raw() => {
                    if found.size() > 0 {
                        return Ok(Occupant::Own);
                    }
                }
                Ok(_) => return Ok(Occupant::Foreign),
            }
            if begun.elapsed() >= self.timeout {
                return Err(DynamicStorageOpenError::InitializationNotYetFinalized);
            }
            thread::sleep(PAUSE);
        }
    }

    /// Creates the object, with all its pages. An object that exists is not opened.
    fn create_whole(&mut self) -> Result<OwnStorage<T>, DynamicStorageCreateError> {
        // iceoryx2 writes into the first page before it calls the initializer, which allocates all.
        let size = (size_of::<T>() + self.supplementary_size) as u64;
        let found = statvfs(SHARED_MEMORY).ok().filter(|found| found.f_blocks > 0);
        if found.is_some_and(|found| found.f_bavail * found.f_frsize < size + SPARE) {
            REFUSED.set(size);
            return Err(DynamicStorageCreateError::InternalError);
        }
        Ok(OwnStorage { storage: self.inner().create()? })
    }

    /// iceoryx2's builder with the same settings. Nobody else gets permissions.
    fn inner(&mut self) -> Builder<'_, T> {
        let path = self.path();
        let initializer = &mut self.initializer;
        Builder::new(&self.name)
            .config(&self.config)
            .supplementary_size(self.supplementary_size)
            .has_ownership(self.has_ownership)
            .timeout(self.timeout)
            .initializer(move |value: &mut MaybeUninit<T>, allocator: &mut BumpAllocator| {
                allocate(&path) && initializer.call(value, allocator)
            })
    }
}

/// Makes the kernel allocate the first `size` bytes of a file now. Returns whether there was room. A signal that comes
/// meanwhile takes back what was allocated, so it is tried again. A file system that cannot is as good as room.
#[must_use]
pub fn allocate_pages(file: &File, size: u64) -> bool {
    retry_on_intr(|| fallocate(file, FallocateFlags::empty(), 0, size)) != Err(Errno::NOSPC)
}

/// Makes the kernel allocate all pages of the object that this process is just creating. Returns whether it could.
fn allocate(path: &str) -> bool {
    let flags = OFlags::NOFOLLOW | OFlags::CLOEXEC;
    let opened = File::options().write(true).custom_flags(flags.bits().cast_signed()).open(path);
    // If somebody has removed it, there is nothing to allocate in a file; it stays as it was without this function.
    let Ok((size, file)) = opened.and_then(|file| Ok((file.metadata()?.size(), file))) else { return true };
    let full = !allocate_pages(&file, size);
    // A smaller object that found room does not change why the larger one has failed.
    if full || size >= REFUSED.get() {
        REFUSED.set(if full { size } else { 0 });
    }
    !full
}

impl<T: Debug + Send + Sync + ZeroCopySend + 'static> NamedConceptBuilder<OwnStorage<T>> for OwnStorageBuilder<'_, T> {
    fn new(name: &FileName) -> Self {
        Self {
            name: *name,
            config: Configuration::default(),
            supplementary_size: 0,
            has_ownership: true,
            timeout: Duration::ZERO,
            initializer: Initializer::new(|_, _| false),
        }
    }

    fn config(mut self, config: &Configuration<T>) -> Self {
        self.config = config.clone();
        self
    }
}

impl<'builder, T: Debug + Send + Sync + ZeroCopySend + 'static> DynamicStorageBuilder<'builder, T, OwnStorage<T>>
    for OwnStorageBuilder<'builder, T>
{
    fn has_ownership(mut self, value: bool) -> Self {
        self.has_ownership = value;
        self
    }

    fn enable_global_access(self, _: bool) -> Self {
        self
    }

    fn supplementary_size(mut self, value: usize) -> Self {
        self.supplementary_size = value;
        self
    }

    fn timeout(mut self, value: Duration) -> Self {
        self.timeout = value;
        self
    }

    fn initializer<F: FnMut(&mut MaybeUninit<T>, &mut BumpAllocator) -> bool + 'builder>(mut self, value: F) -> Self {
        self.initializer = Initializer::new(value);
        self
    }

    fn create(mut self) -> Result<OwnStorage<T>, DynamicStorageCreateError> {
        self.create_whole()
    }

    fn open(mut self, access_mode: AccessMode) -> Result<OwnStorage<T>, DynamicStorageOpenError> {
        match self.find()? {
            Occupant::Nothing => Err(DynamicStorageOpenError::DoesNotExist),
            Occupant::Own => Ok(OwnStorage { storage: self.inner().open(access_mode)? }),
            Occupant::Foreign => Err(DynamicStorageOpenError::InternalError),
        }
    }

    fn open_or_create(mut self) -> Result<OwnStorage<T>, DynamicStorageOpenOrCreateError> {
        for _ in 0..MAX_ATTEMPTS {
            match self.find()? {
                Occupant::Nothing => match self.create_whole() {
                    Err(DynamicStorageCreateError::AlreadyExists) => {}
                    result => return Ok(result?),
                },
                Occupant::Own => match self.inner().open(AccessMode::ReadWrite) {
                    Err(DynamicStorageOpenError::DoesNotExist) => {}
                    result => return Ok(OwnStorage { storage: result? }),
                },
                Occupant::Foreign => return Err(DynamicStorageOpenError::InternalError.into()),
            }
        }
        Err(DynamicStorageOpenError::InternalError.into())
    }
}

impl<T: Debug + Send + Sync + ZeroCopySend> Abandonable for OwnStorage<T> {
    unsafe fn abandon_in_place(mut this: NonNull<Self>) {
        // SAFETY: the caller's promises are passed on to the field.
        unsafe { Storage::abandon_in_place(NonNull::from_mut(&mut this.as_mut().storage)) };
    }
}

impl<T: Debug + Send + Sync + ZeroCopySend> NamedConcept for OwnStorage<T> {
    fn name(&self) -> &FileName {
        self.storage.name()
    }
}

impl<T: Debug + Send + Sync + ZeroCopySend> NamedConceptMgmt for OwnStorage<T> {
    type Configuration = Configuration<T>;

    fn does_exist_cfg(name: &FileName, config: &Configuration<T>) -> Result<bool, NamedConceptDoesExistError> {
        Storage::<T>::does_exist_cfg(name, config)
    }

    fn list_cfg(config: &Configuration<T>) -> Result<Vec<FileName>, NamedConceptListError> {
        Storage::<T>::list_cfg(config)
    }

    unsafe fn remove_cfg(name: &FileName, config: &Configuration<T>) -> Result<bool, NamedConceptRemoveError> {
        // SAFETY: the caller's promise, that no other process uses the object, is passed on.
        unsafe { Storage::<T>::remove_cfg(name, config) }
    }

    fn remove_path_hint(value: &Path) -> Result<(), NamedConceptPathHintRemoveError> {
        Storage::<T>::remove_path_hint(value)
    }
}

impl<T: Debug + Send + Sync + ZeroCopySend + 'static> DynamicStorage<T> for OwnStorage<T> {
    type Builder<'builder> = OwnStorageBuilder<'builder, T>;

    fn does_support_persistency() -> bool {
        Storage::<T>::does_support_persistency()
    }

    fn has_ownership(&self) -> bool {
        self.storage.has_ownership()
    }

    fn release_ownership(&self) {
        self.storage.release_ownership();
    }

    fn acquire_ownership(&self) {
        self.storage.acquire_ownership();
    }

    fn get(&self) -> &T {
        self.storage.get()
    }

    unsafe fn __internal_set_type_name_in_config(config: &mut Configuration<T>, type_name: &str) {
        // SAFETY: the caller's promise, that the name is that of the contained type, is passed on.
        unsafe { Storage::<T>::__internal_set_type_name_in_config(config, type_name) };
    }
}
