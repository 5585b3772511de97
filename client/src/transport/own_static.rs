//! Files of the transport that never change: descriptions of streams and processes, and marks.
//!
//! [`OwnStatic`] is iceoryx2's storage in files with two differences. Dropping it removes only the file that it has
//! created or opened: iceoryx2 removes whatever has the name, and where the memory of a domain was removed under its
//! processes, the last one to leave the old streams would remove the files of the new ones. And another program that
//! the process executes does not get the file.
#![expect(
    unsafe_code,
    reason = "functions of iceoryx2's traits are unsafe, and are passed on; descriptors are known by their numbers"
)]

use core::ptr::NonNull;
use core::time::Duration;
use iceoryx2::prelude::{FileName, Path};
use iceoryx2_bb_elementary_traits::testing::abandonable::Abandonable;
use iceoryx2_cal::named_concept::{
    NamedConcept, NamedConceptBuilder, NamedConceptConfiguration as _, NamedConceptDoesExistError,
    NamedConceptListError, NamedConceptMgmt, NamedConceptPathHintRemoveError, NamedConceptRemoveError,
};
use iceoryx2_cal::static_storage::file::{Builder, Configuration, Locked, Storage, StorageView};
use iceoryx2_cal::static_storage::{
    StaticStorage, StaticStorageBuilder, StaticStorageCreateError, StaticStorageLocked, StaticStorageOpenError,
    StaticStorageReadError, StaticStorageUnlockError, StaticStorageView,
};
use rustix::io::{FdFlags, fcntl_setfd};
use std::fs;
use std::os::fd::{BorrowedFd, RawFd};
use std::os::unix::fs::MetadataExt as _;

/// Number of a file: device and inode; `None` if there is no file.
type FileNumber = Option<(u64, u64)>;

/// iceoryx2's storage in files, which removes its own file only.
#[derive(Debug)]
pub struct OwnStatic {
    storage: Storage,
    path: String,
    number: FileNumber,
}

impl OwnStatic {
    fn new(storage: Storage, path: String) -> Self {
        let number = number_of(&path);
        let name = path.rsplit('/').next().unwrap_or_default();
        close_on_exec(|other| other == name);
        Self { storage, path, number }
    }
}

/// Sees to it that a program which this process executes does not get its open files of these names. The transport
/// opens them without that.
pub(crate) fn close_on_exec(is_meant: impl Fn(&str) -> bool) {
    for entry in fs::read_dir("/proc/self/fd").into_iter().flatten().flatten() {
        let Ok(target) = fs::read_link(entry.path()) else { continue };
        let name = target.file_name().and_then(|name| name.to_str());
        let number = entry.file_name().to_str().and_then(|number| number.parse::<RawFd>().ok());
        if let (true, Some(number)) = (name.is_some_and(&is_meant), number) {
            // SAFETY: the number is used for one call, which only sets a flag. If another thread has closed the file
            // since its name was read, there is nothing under the number, or another file whose flag is set.
            let file = unsafe { BorrowedFd::borrow_raw(number) };
            // There may be nothing.
            let _ = fcntl_setfd(file, FdFlags::CLOEXEC);
        }
    }
}

fn number_of(path: &str) -> FileNumber {
    fs::symlink_metadata(path).ok().map(|found| (found.dev(), found.ino()))
}

impl Drop for OwnStatic {
    fn drop(&mut self) {
        if self.number != number_of(&self.path) {
            self.storage.release_ownership();
        }
    }
}

/// Builder of [`OwnStatic`].
#[derive(Debug)]
pub struct OwnStaticBuilder {
    inner: Builder,
    name: FileName,
    config: Configuration,
}

impl OwnStaticBuilder {
    fn path(&self) -> String {
        self.config.path_for(&self.name).to_string()
    }
}

impl NamedConceptBuilder<OwnStatic> for OwnStaticBuilder {
    fn new(name: &FileName) -> Self {
        Self { inner: Builder::new(name), name: *name, config: Configuration::default() }
    }

    fn config(mut self, config: &Configuration) -> Self {
        self.inner = self.inner.config(config);
        self.config = config.clone();
        self
    }
}

impl StaticStorageBuilder<OwnStatic> for OwnStaticBuilder {
    fn has_ownership(mut self, value: bool) -> Self {
        self.inner = self.inner.has_ownership(value);
        self
    }

    fn create_locked(self) -> Result<OwnStaticLock, StaticStorageCreateError> {
        let path = self.path();
        Ok(OwnStaticLock { locked: self.inner.create_locked()?, path })
    }

    fn open(self, timeout: Duration) -> Result<OwnStatic, StaticStorageOpenError> {
        let path = self.path();
        Ok(OwnStatic::new(self.inner.open(timeout)?, path))
    }
}

/// An [`OwnStatic`] that has no content yet.
#[derive(Debug)]
pub struct OwnStaticLock {
    locked: Locked,
    path: String,
}

impl StaticStorageLocked<OwnStatic> for OwnStaticLock {
    fn unlock(self, contents: &[u8]) -> Result<OwnStatic, StaticStorageUnlockError> {
        Ok(OwnStatic::new(self.locked.unlock(contents)?, self.path))
    }
}

impl NamedConcept for OwnStaticLock {
    fn name(&self) -> &FileName {
        self.locked.name()
    }
}

impl Abandonable for OwnStaticLock {
    unsafe fn abandon_in_place(mut this: NonNull<Self>) {
        // SAFETY: the caller's promises are passed on to the field.
        unsafe { Locked::abandon_in_place(NonNull::from_mut(&mut this.as_mut().locked)) };
    }
}

impl Abandonable for OwnStatic {
    unsafe fn abandon_in_place(mut this: NonNull<Self>) {
        // SAFETY: the caller's promises are passed on to the field.
        unsafe { Storage::abandon_in_place(NonNull::from_mut(&mut this.as_mut().storage)) };
    }
}

impl NamedConcept for OwnStatic {
    fn name(&self) -> &FileName {
        self.storage.name()
    }
}

impl NamedConceptMgmt for OwnStatic {
    type Configuration = Configuration;

    unsafe fn remove_cfg(name: &FileName, config: &Configuration) -> Result<bool, NamedConceptRemoveError> {
        // SAFETY: the caller's promise, that no other process uses the file, is passed on.
        unsafe { Storage::remove_cfg(name, config) }
    }

    fn does_exist_cfg(name: &FileName, config: &Configuration) -> Result<bool, NamedConceptDoesExistError> {
        Storage::does_exist_cfg(name, config)
    }

    fn list_cfg(config: &Configuration) -> Result<Vec<FileName>, NamedConceptListError> {
        Storage::list_cfg(config)
    }

    fn remove_path_hint(value: &Path) -> Result<(), NamedConceptPathHintRemoveError> {
        Storage::remove_path_hint(value)
    }
}

impl StaticStorageView for OwnStatic {
    fn len(&self) -> u64 {
        self.storage.len()
    }

    fn is_empty(&self) -> bool {
        self.storage.is_empty()
    }

    fn read(&self, content: &mut [u8]) -> Result<(), StaticStorageReadError> {
        self.storage.read(content)
    }
}

impl StaticStorage for OwnStatic {
    type Builder = OwnStaticBuilder;
    type Locked = OwnStaticLock;
    type View = StorageView;

    fn view(&self) -> &StorageView {
        self.storage.view()
    }

    fn release_ownership(&self) {
        self.storage.release_ownership();
    }

    fn acquire_ownership(&self) {
        self.storage.acquire_ownership();
    }
}
