//! Text files of sysfs.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use super::error::IioError;

/// Most bytes of one attribute: a page.
const ATTRIBUTE: u64 = 4096;

/// What stands for the kernel in tests: it sees each write before it is done, and says what is kept, or refuses it.
#[cfg(test)]
pub(super) type Kernel = std::sync::Arc<dyn Fn(&Path, &str) -> io::Result<String> + Send + Sync>;

/// Where sysfs and the device nodes are.
#[derive(Clone)]
pub(super) struct Tree {
    root: PathBuf,
    #[cfg(test)]
    pub(super) kernel: Option<Kernel>,
}

impl Tree {
    pub(super) fn new(root: &Path) -> Self {
        Self {
            root: root.to_owned(),
            #[cfg(test)]
            kernel: None,
        }
    }

    /// The folder with a folder for each device and trigger.
    pub(super) fn devices(&self) -> PathBuf {
        self.root.join("sys/bus/iio/devices")
    }

    /// The node of device `index`.
    pub(super) fn node(&self, index: u32) -> PathBuf {
        self.root.join(format!("dev/iio:device{index}"))
    }

    /// The attributes in a folder; `owner` names the device in messages.
    pub(super) fn folder(&self, path: PathBuf, owner: &str) -> Folder {
        Folder { tree: self.clone(), path, owner: owner.to_owned() }
    }
}

/// The attributes in one folder of sysfs.
#[derive(Clone)]
pub(super) struct Folder {
    tree: Tree,
    pub(super) path: PathBuf,
    owner: String,
}

impl Folder {
    /// A phase of this device, for messages.
    pub(super) fn phase(&self, doing: &str) -> String {
        format!("{}: {doing}", self.owner)
    }

    pub(super) fn sub(&self, name: &str) -> Self {
        Self { path: self.path.join(name), ..self.clone() }
    }

    /// The names of all attributes and folders, sorted; none if the folder is not there.
    pub(super) fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(&self.path)
            .into_iter()
            .flatten()
            .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
            .collect();
        names.sort();
        names
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.path.join(name).exists()
    }

    /// The text of an attribute without white space at its ends; `None` if it is not there.
    pub(super) fn read(&self, name: &str) -> Result<Option<String>, IioError> {
        let path = self.path.join(name);
        match text(&path) {
            Ok(text) => Ok(Some(text)),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(IioError::io(self.phase(&format!("reading {name}")), &path, &error)),
        }
    }

    /// The text of an attribute, `None` if it cannot be read for whatever reason.
    pub(super) fn glance(&self, name: &str) -> Option<String> {
        text(&self.path.join(name)).ok()
    }

    /// Writes an attribute that is there.
    pub(super) fn write(&self, name: &str, value: &str) -> Result<(), IioError> {
        self.try_write(name, value).map_err(|error| self.failed(name, value, &error))
    }

    pub(super) fn failed(&self, name: &str, value: &str, error: &io::Error) -> IioError {
        IioError::io(self.phase(&format!("setting {name} to {value}")), &self.path.join(name), error)
    }

    /// As [`Self::write`], for callers that judge the cause.
    pub(super) fn try_write(&self, name: &str, value: &str) -> io::Result<()> {
        let path = self.path.join(name);
        #[cfg(test)]
        let kept = self.tree.kernel.as_ref().map(|kernel| kernel(&path, value)).transpose()?;
        #[cfg(test)]
        let value = kept.as_deref().unwrap_or(value);
        // One write: the kernel takes each as a whole value.
        OpenOptions::new().write(true).truncate(true).open(&path)?.write_all(value.as_bytes())
    }

    pub(super) fn tree(&self) -> &Tree {
        &self.tree
    }
}

fn text(path: &Path) -> io::Result<String> {
    let mut bytes = Vec::new();
    File::open(path)?.take(ATTRIBUTE).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).trim().to_owned())
}
