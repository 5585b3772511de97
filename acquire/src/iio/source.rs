//! The source: one device or two, read together.

use std::path::Path;

use rustix::fd::{BorrowedFd, OwnedFd};

use super::clock::IioClock;
use super::device::devices;
use super::element::TIMESTAMP;
use super::error::{IioError, IioFault};
use super::join::{Ring, join};
use super::output::{IioCounters, Output, Scan};
use super::resolve::{Channel, DeviceBuffer, TemperatureSource, column, members, temperature};
use super::scale::{IioScale, scale};
use super::settings::IioSettings;
use super::setup::{DeviceSetup, claim, enable, prepare};
use super::stream::{ScanSelection, Stream, waiting};
use super::sysfs::Tree;
use super::temperature::{PolledTemperature, Temperature};

/// Reads of each descriptor in one call at most: a device that never is silent must not hold up its caller.
const READS: usize = 16;

/// Devices that run. Dropping it switches their buffers off.
pub struct IioSource {
    streams: Vec<Stream>,
    /// Two streams: the rows that wait for a partner, and what becomes of their numbers.
    rings: Option<(Ring, Ring)>,
    within: u64,
    output: Output,
    poll_ns: u64,
    next_poll_ns: u64,
    clock: IioClock,
    scales: Vec<IioScale>,
    remarks: Vec<String>,
}

/// Sets the devices up and starts their buffers.
///
/// `root` is `/`, or the root of a tree with `sys/bus/iio/devices` and `dev`, for tests. A buffer that a killed program
/// has left on is started anew.
///
/// # Errors
///
/// Phase, cause and remedy, if a device is not there, is not only ours, lacks a channel, rate or right, or refuses.
pub fn open(root: &Path, settings: &IioSettings) -> Result<IioSource, IioError> {
    open_tree(&Tree::new(root), settings)
}

pub(super) fn open_tree(tree: &Tree, settings: &IioSettings) -> Result<IioSource, IioError> {
    if settings.columns.is_empty() || settings.interval_ns == 0 {
        let cause = "no column is wanted, or the interval is 0";
        return Err(IioError::new(IioFault::Description, "IIO", cause, "name channels, and give timing.interval_s"));
    }
    let all = devices(tree);
    let members = members(&all, settings)?;
    let columns = settings.columns.iter().map(|name| column(&all, &members, name)).collect::<Result<Vec<_>, _>>()?;
    let temperature =
        settings.temperature.iter().map(|name| temperature(&all, &members, name)).collect::<Result<Vec<_>, _>>()?;
    let scanned = temperature.iter().filter_map(|place| match place {
        TemperatureSource::Scanned(channel) => Some(channel.clone()),
        TemperatureSource::Polled(..) => None,
    });
    let numbers: Vec<Channel> = columns.iter().cloned().chain(scanned).collect();

    let claimed = members.iter().map(|member| claim(tree, member.device, &member.buffer));
    let nodes = claimed.collect::<Result<Vec<_>, _>>()?;
    let mut prepared = Vec::new();
    for (at, member) in members.iter().enumerate() {
        let of_member = numbers.iter().filter(|channel| channel.member == at);
        let names: Vec<String> = of_member.map(|channel| channel.name.clone()).collect();
        if names.is_empty() {
            let phase = member.device.folder.phase("looking for wanted channels");
            let remedy = "take the device out of `device` in [iio], or name its channels as DEVICE/CHANNEL";
            return Err(IioError::new(IioFault::Description, phase, "no column is one of its channels", remedy));
        }
        prepared.push(prepare(tree, member.device, &member.buffer, &names, settings)?);
    }
    let clock = common_clock(&members, &prepared)?;
    let scales = columns
        .iter()
        .filter_map(|channel| Some(scale(&members.get(channel.member)?.device.folder, &channel.name)))
        .collect::<Result<Vec<_>, _>>()?;
    let temperatures = temperatures(&members, temperature, columns.len())?;
    let rows = prepared.iter().map(|prepared| waiting(prepared.length)).max().unwrap_or_default();
    let streams = start(tree, &members, nodes, prepared, &numbers)?;
    let rings = match &streams[..] {
        [first, second] => Some((first.ring(rows), second.ring(rows))),
        _ => None,
    };
    let remarks = remarks(&settings.columns, &scales, &clock);
    let output = Output::new(numbers.len(), columns.len(), temperatures)?;
    let within = settings.interval_ns / 2;
    Ok(IioSource { streams, rings, within, output, poll_ns: settings.poll_ns, next_poll_ns: 0, clock, scales, remarks })
}

/// The one clock of all devices.
fn common_clock(members: &[DeviceBuffer<'_>], prepared: &[DeviceSetup]) -> Result<IioClock, IioError> {
    let clocks: Vec<&IioClock> = prepared.iter().map(|prepared| &prepared.clock).collect();
    match clocks[..] {
        [first] => Ok(first.clone()),
        [first, second] if first == second && *first != IioClock::None => Ok(first.clone()),
        _ => {
            let titles: Vec<String> = members.iter().map(|member| member.device.title()).collect();
            let phase = format!("IIO devices {}: joining their scans", titles.join(" and "));
            let cause = format!("their timestamps are of different clocks, or there are none ({clocks:?})");
            let remedy = "write the same clock into current_timestamp_clock of both; without timestamps two devices \
                          cannot be joined";
            Err(IioError::new(IioFault::Description, phase, cause, remedy))
        }
    }
}

fn temperatures(
    members: &[DeviceBuffer<'_>],
    temperature: Vec<TemperatureSource<'_>>,
    columns: usize,
) -> Result<Vec<Temperature>, IioError> {
    let mut slot = columns;
    let mut temperatures = Vec::new();
    for place in temperature {
        match place {
            TemperatureSource::Scanned(channel) => {
                if let Some(member) = members.get(channel.member) {
                    temperatures.push(Temperature::scanned(&member.device.folder, &channel.name, slot)?);
                }
                slot += 1;
            }
            TemperatureSource::Polled(device, channel) => {
                temperatures.push(Temperature::Polled(PolledTemperature::open(device, &channel)?));
            }
        }
    }
    Ok(temperatures)
}

/// The streams, started.
fn start(
    tree: &Tree,
    members: &[DeviceBuffer<'_>],
    nodes: Vec<OwnedFd>,
    prepared: Vec<DeviceSetup>,
    numbers: &[Channel],
) -> Result<Vec<Stream>, IioError> {
    let mut streams = Vec::new();
    let claimed = members.iter().enumerate().zip(nodes).zip(prepared);
    for (((at, member), node), DeviceSetup { layout, clock, .. }) in claimed {
        let folder = &member.buffer.elements;
        let of_member = numbers.iter().enumerate().filter(|(_, channel)| channel.member == at);
        let (slots, names): (Vec<usize>, Vec<&str>) = of_member.map(|(at, channel)| (at, &channel.name[..])).unzip();
        let places = names.iter().map(|name| layout.place(folder, name)).collect::<Result<_, _>>()?;
        let timestamp = (clock != IioClock::None).then(|| layout.place(folder, TIMESTAMP)).transpose()?;
        let wanted = ScanSelection { timestamp, places, slots: slots.into_boxed_slice() };
        let (path, control) = (tree.node(member.device.index), member.buffer.control.clone());
        // From here on dropping it switches the buffer off.
        streams.push(Stream::new(node, path, control, wanted, layout.bytes));
        enable(tree, member.device, &member.buffer)?;
    }
    Ok(streams)
}

/// What the user should know and no error says.
fn remarks(columns: &[String], scales: &[IioScale], clock: &IioClock) -> Vec<String> {
    let mut remarks = Vec::new();
    for (column, scale) in columns.iter().zip(scales).filter(|(_, scale)| scale.rounding > 0.01) {
        remarks.push(format!(
            "{column}: the kernel gives its scale as {}, cut off after its last digit: it may be {:.0} % more; take it \
             from the data sheet",
            scale.scale,
            scale.rounding * 100.0
        ));
    }
    match clock {
        IioClock::Monotonic => {}
        IioClock::Other(clock) => {
            remarks.push(format!("timestamps are of the clock {clock}, which is not monotonic: arrival counts"));
        }
        IioClock::None => remarks.push("the device has no timestamps: arrival counts".to_owned()),
    }
    remarks
}

impl IioSource {
    /// Descriptors to poll for reading, one or two.
    pub fn descriptors(&self) -> impl Iterator<Item = BorrowedFd<'_>> {
        self.streams.iter().map(Stream::descriptor)
    }

    /// Reads what is there, without waiting, and gives each scan to `sink`, of two devices each joined pair. Polls the
    /// temperatures when that is due; `now_ns` is any monotonic time. Allocates nothing.
    ///
    /// It reads a bounded number of scans: more may be there at once.
    ///
    /// # Errors
    ///
    /// If a device went away ([`IioFault::Gone`]) or cannot be read. What was read before was given to `sink`.
    pub fn read(&mut self, now_ns: u64, sink: &mut dyn FnMut(Scan<'_>)) -> Result<(), IioError> {
        if self.output.polled_ns.is_some() && now_ns >= self.next_poll_ns {
            self.output.poll(now_ns)?;
            self.next_poll_ns = now_ns.saturating_add(self.poll_ns.max(1));
        }
        for _ in 0..READS {
            if !self.read_once(sink)? {
                break;
            }
        }
        Ok(())
    }

    /// Reads each descriptor once; whether there may be more.
    fn read_once(&mut self, sink: &mut dyn FnMut(Scan<'_>)) -> Result<bool, IioError> {
        let mut is_more = false;
        let (rings, output) = (&mut self.rings, &mut self.output);
        for (at, stream) in self.streams.iter_mut().enumerate() {
            is_more |= stream.fill()?;
            stream.scans(|wanted, scan| {
                let timestamp = wanted.timestamp.map(|place| place.read(scan));
                let numbers = wanted.places.iter().map(|place| place.read(scan));
                match rings {
                    None => {
                        output.put(&wanted.slots, numbers);
                        output.give(timestamp, sink);
                    }
                    Some((first, second)) => {
                        let ring = if at == 0 { first } else { second };
                        let is_lost = ring.push(timestamp.unwrap_or_default(), numbers);
                        output.counters.unpaired += u64::from(is_lost);
                    }
                }
            });
        }
        if let (Some((first, second)), [of_first, of_second]) = (rings, &self.streams[..]) {
            let lonely = join(first, second, self.within, |timestamp, a, b| {
                output.put(&of_first.wanted.slots, a.iter().copied());
                output.put(&of_second.wanted.slots, b.iter().copied());
                output.give(Some(timestamp), sink);
            });
            output.counters.unpaired += lonely;
        }
        Ok(is_more)
    }

    /// The clock of [`Scan::timestamp_ns`].
    pub fn clock(&self) -> &IioClock {
        &self.clock
    }

    /// Scale and offset of each column, in their order.
    pub fn scales(&self) -> &[IioScale] {
        &self.scales
    }

    /// What was counted since [`open`].
    pub fn counters(&self) -> IioCounters {
        self.output.counters
    }

    /// What the user should know: scales that the kernel cuts off, a clock that is not monotonic.
    pub fn remarks(&self) -> &[String] {
        &self.remarks
    }
}
