//! A tree of files as sysfs, and pipes as device nodes.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rustix::fs::{CWD, FileType, Mode, mknodat};

use super::super::source::open_tree;
use super::super::sysfs::Tree;
use super::super::{IioError, IioSettings, IioSource, Scan};

/// A root with `sys` and `dev`; removed at the end.
pub(super) struct Fake {
    root: tempfile::TempDir,
    pub(super) tree: Tree,
}

impl Fake {
    pub(super) fn new() -> Self {
        let root = tempfile::tempdir().unwrap();
        fs::create_dir_all(root.path().join("sys/bus/iio/devices")).unwrap();
        fs::create_dir_all(root.path().join("dev")).unwrap();
        let tree = Tree::new(root.path());
        Self { root, tree }
    }

    /// A root with the devices of these records, numbered from 0.
    pub(super) fn with(records: &[&str]) -> Self {
        let fake = Self::new();
        for (index, record) in records.iter().enumerate() {
            fake.device(index, record);
        }
        fake
    }

    pub(super) fn root(&self) -> &Path {
        self.root.path()
    }

    fn file(&self, path: &str) -> PathBuf {
        self.tree.devices().join(path)
    }

    /// A device of a record: lines of `attribute: text`.
    pub(super) fn device(&self, index: usize, record: &str) {
        self.folder(&format!("iio:device{index}"), record);
        let node = self.root().join(format!("dev/iio:device{index}"));
        mknodat(CWD, &node, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
    }

    /// A folder of attributes, as of a trigger.
    pub(super) fn folder(&self, name: &str, record: &str) {
        for line in record.lines().filter(|line| !line.trim().is_empty()) {
            let (attribute, text) = line.trim().split_once(':').unwrap();
            self.set(&format!("{name}/{attribute}"), text.trim());
        }
    }

    pub(super) fn set(&self, path: &str, text: &str) {
        let path = self.file(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, format!("{text}\n")).unwrap();
    }

    pub(super) fn get(&self, path: &str) -> String {
        fs::read_to_string(self.file(path)).unwrap().trim().to_owned()
    }

    pub(super) fn remove(&self, path: &str) {
        fs::remove_file(self.file(path)).unwrap();
    }

    /// What the kernel makes of each write, by the path below the folder of devices and the value.
    pub(super) fn kernel(&mut self, kernel: impl Fn(&str, &str) -> io::Result<String> + Send + Sync + 'static) {
        let devices = self.tree.devices();
        self.tree.kernel = Some(Arc::new(move |path: &Path, value: &str| {
            kernel(path.strip_prefix(&devices).unwrap().to_str().unwrap(), value)
        }));
    }

    /// A kernel that refuses to write one attribute.
    pub(super) fn refuse(&mut self, attribute: &'static str, errno: rustix::io::Errno) {
        self.kernel(move |path, value| if path == attribute { Err(errno.into()) } else { Ok(value.to_owned()) });
    }

    pub(super) fn open(&self, settings: &IioSettings) -> Result<IioSource, IioError> {
        open_tree(&self.tree, settings)
    }

    /// The message of an opening that fails.
    pub(super) fn fault(&self, settings: &IioSettings) -> IioError {
        self.open(settings).err().expect("this cannot be opened")
    }

    /// The driver's end of a node whose source is open.
    pub(super) fn driver(&self, index: usize) -> File {
        OpenOptions::new().write(true).open(self.root().join(format!("dev/iio:device{index}"))).unwrap()
    }
}

/// Settings for one device or two, `devices` separated by spaces, 100 Hz.
pub(super) fn settings(devices: &str, columns: &str, temperature: &str) -> IioSettings {
    let words = |text: &str| text.split_whitespace().map(str::to_owned).collect();
    IioSettings {
        devices: words(devices),
        trigger: None,
        watermark: 1,
        interval_ns: 10_000_000,
        columns: words(columns),
        temperature: words(temperature),
        poll_ns: 1_000_000_000,
    }
}

/// The six channels of an IMU.
pub(super) const SIX: &str = "accel_x accel_y accel_z anglvel_x anglvel_y anglvel_z";

/// A scan that outlives the call.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Kept {
    pub(super) values: Vec<i64>,
    pub(super) temperatures: Vec<f64>,
    pub(super) timestamp_ns: Option<i64>,
    pub(super) polled_ns: Option<u64>,
}

impl From<Scan<'_>> for Kept {
    fn from(scan: Scan<'_>) -> Self {
        Self {
            values: scan.values.to_vec(),
            temperatures: scan.temperatures.to_vec(),
            timestamp_ns: scan.timestamp_ns,
            polled_ns: scan.polled_ns,
        }
    }
}

/// All that is there now.
pub(super) fn read(source: &mut IioSource, now_ns: u64) -> Vec<Kept> {
    let mut kept = Vec::new();
    source.read(now_ns, &mut |scan| kept.push(scan.into())).unwrap();
    kept
}

/// Writes bytes as a driver.
pub(super) fn push(driver: &mut File, bytes: &[u8]) {
    driver.write_all(bytes).unwrap();
}
