//! Linux Industrial I/O: IMUs whose driver is in the kernel.
//!
//! The module reads the kernel's ABI itself (`Documentation/ABI/testing/sysfs-bus-iio`): a few text files to set up and
//! one descriptor to read, where the crate `industrial-io` needs the C library libiio at build and at run time.
//!
//! [`open`] sets the devices up and starts their buffers. [`IioSource::read`] gives each scan, that is one sample of
//! all wanted channels, as raw numbers. `value = (raw + offset) * scale` in m/s2 or rad/s, see [`IioSource::scales`].
//!
//! All memory is taken by [`open`]: reading allocates nothing.

mod clock;
mod device;
mod element;
mod error;
mod format;
mod join;
mod list;
mod output;
mod rate;
mod resolve;
mod scale;
mod settings;
mod setup;
mod source;
mod stream;
mod sysfs;
mod temperature;
#[cfg(test)]
mod tests;

pub use clock::IioClock;
pub use error::{IioError, IioFault};
pub use list::{IioChannel, IioDevice, IioRate, list};
pub use output::{IioCounters, Scan};
pub use scale::IioScale;
pub use settings::IioSettings;
pub use source::{IioSource, open};
