//! The source: one device or two, read together.

use std::path::Path;

use rustix::fd::BorrowedFd;
use rustix::io::Errno;

use super::IioSettings;
use super::device::devices;
use super::element::TIMESTAMP;
use super::error::{IioError, IioFault};
use super::join::{Ring, join};
use super::resolve::{Channel, Member, Telemetry, column, members, telemetry};
use super::scale::{IioScale, scale};
use super::setup::{Prepared, enable, prepare};
use super::stream::{Stream, Wanted, waiting};
use super::sysfs::Tree;
use super::temperature::{Polled, Temperature, celsius};

/// Reads of each descriptor in one call at most: a device that never is silent must not hold up its caller.
const READS: usize = 16;

/// The clock of the timestamps.
#[derive(Clone, Debug, Eq, PartialEq)]
pub enum IioClock {
    /// CLOCK_MONOTONIC.
    Monotonic,
    /// Another one, by the kernel's name, as `realtime`: it may jump, so take the time of arrival.
    Other(String),
    /// There are no timestamps: take the time of arrival.
    None,
}

/// One sample of all wanted channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scan<'a> {
    /// Raw numbers in the order of [`IioSettings::columns`].
    pub values: &'a [i64],
    /// Temperatures in the order of [`IioSettings::temperature`] \[degC\].
    pub temperatures: &'a [f64],
    /// When the polled temperatures were last read \[ns\], in the caller's time; `None` if none is polled.
    pub polled_ns: Option<u64>,
    /// When the sample was taken \[ns\], on [`IioSource::clock`]; of two devices, that of the first. `None` without a
    /// clock.
    pub timestamp_ns: Option<i64>,
}

/// What was counted since [`open`].
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct IioCounters {
    /// Scans handed out.
    pub scans: u64,
    /// Scans of one of two devices for which the other had none within half an interval. A few are usual at the start:
    /// the devices start one after the other.
    pub unpaired: u64,
    /// Polls of a temperature that failed: the last one stays.
    pub failed_polls: u64,
}

/// Devices that run. Dropping it switches their buffers off.
pub struct IioSource {
    streams: Vec<Stream>,
    /// Of two streams: the rows that wait for a partner, and what becomes of their numbers.
    rings: Option<(Ring, Ring)>,
    within: u64,
    /// For each stream, the slots of its numbers.
    slots: Vec<Box<[usize]>>,
    output: Output,
    poll_ns: u64,
    next_poll_ns: u64,
    clock: IioClock,
    scales: Vec<IioScale>,
    remarks: Vec<String>,
}

/// What a scan is made of.
struct Output {
    /// The columns, then the scanned temperatures.
    numbers: Box<[i64]>,
    columns: usize,
    temperatures: Box<[Temperature]>,
    celsius: Box<[f64]>,
    polled_ns: Option<u64>,
    counters: IioCounters,
}

/// Sets the devices up and starts their buffers.
///
/// `root` is `/`, or the root of a tree with `sys/bus/iio/devices` and `dev`, for tests. A buffer that a killed program
/// has left on is started anew.
///
/// # Errors
///
/// Phase, cause and remedy, if a device is not there, not alone ours, lacks a channel, rate or right, or refuses.
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
    let telemetry =
        settings.temperature.iter().map(|name| telemetry(&all, &members, name)).collect::<Result<Vec<_>, _>>()?;
    let scanned = telemetry.iter().filter_map(|place| match place {
        Telemetry::Scanned(channel) => Some(channel.clone()),
        Telemetry::Polled(..) => None,
    });
    let numbers: Vec<Channel> = columns.iter().cloned().chain(scanned).collect();

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
    let temperatures = temperatures(&members, telemetry, columns.len())?;
    let rows = prepared.iter().map(|prepared| waiting(prepared.length)).max().unwrap_or_default();
    let (streams, slots) = start(tree, &members, prepared, &numbers)?;
    let rings = match &slots[..] {
        [first, second] => Some((Ring::new(rows, first.len()), Ring::new(rows, second.len()))),
        _ => None,
    };
    let remarks = remarks(&settings.columns, &scales, &clock);
    let output = Output::new(numbers.len(), columns.len(), temperatures)?;
    let within = settings.interval_ns / 2;
    Ok(IioSource {
        streams,
        rings,
        within,
        slots,
        output,
        poll_ns: settings.poll_ns,
        next_poll_ns: 0,
        clock,
        scales,
        remarks,
    })
}

/// The one clock of all devices.
fn common_clock(members: &[Member<'_>], prepared: &[Prepared]) -> Result<IioClock, IioError> {
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
    members: &[Member<'_>],
    telemetry: Vec<Telemetry<'_>>,
    columns: usize,
) -> Result<Vec<Temperature>, IioError> {
    let mut slot = columns;
    let mut temperatures = Vec::new();
    for place in telemetry {
        match place {
            Telemetry::Scanned(channel) => {
                if let Some(member) = members.get(channel.member) {
                    temperatures.push(Temperature::scanned(&member.device.folder, &channel.name, slot)?);
                }
                slot += 1;
            }
            Telemetry::Polled(device, channel) => {
                temperatures.push(Temperature::Polled(Polled::open(device, &channel)?));
            }
        }
    }
    Ok(temperatures)
}

/// The streams, started, and for each the slots of its numbers.
#[allow(clippy::type_complexity)]
fn start(
    tree: &Tree,
    members: &[Member<'_>],
    prepared: Vec<Prepared>,
    numbers: &[Channel],
) -> Result<(Vec<Stream>, Vec<Box<[usize]>>), IioError> {
    let (mut streams, mut all_slots) = (Vec::new(), Vec::new());
    for ((at, member), Prepared { node, layout, clock, .. }) in members.iter().enumerate().zip(prepared) {
        let folder = &member.buffer.elements;
        let of_member = numbers.iter().enumerate().filter(|(_, channel)| channel.member == at);
        let (mut slots, mut places) = (Vec::new(), Vec::new());
        for (slot, channel) in of_member {
            slots.push(slot);
            places.push(layout.place(folder, &channel.name)?);
        }
        let timestamp = (clock != IioClock::None).then(|| layout.place(folder, TIMESTAMP)).transpose()?;
        let wanted = Wanted { timestamp, places: places.into_boxed_slice() };
        let (path, control) = (tree.node(member.device.index), member.buffer.control.clone());
        // From here on dropping it switches the buffer off.
        streams.push(Stream::new(node, path, control, wanted, layout.bytes));
        enable(tree, member.device, &member.buffer)?;
        all_slots.push(slots.into_boxed_slice());
    }
    Ok((streams, all_slots))
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
        for (at, (stream, slots)) in self.streams.iter_mut().zip(&self.slots).enumerate() {
            is_more |= stream.fill()?;
            stream.scans(|wanted, scan| {
                let timestamp = wanted.timestamp.map(|place| place.read(scan));
                let numbers = wanted.places.iter().map(|place| place.read(scan));
                match rings {
                    None => {
                        output.put(slots, numbers);
                        output.give(timestamp, sink);
                    }
                    Some((first, second)) => {
                        let ring = if at == 0 { &mut *first } else { &mut *second };
                        let is_lost = ring.push(timestamp.unwrap_or_default(), numbers);
                        output.counters.unpaired += u64::from(is_lost);
                    }
                }
            });
            // After each device: so neither ring overflows while the other device's scans lie in the kernel.
            if let (Some((first, second)), [first_slots, second_slots]) = (rings.as_mut(), &self.slots[..]) {
                let lonely = join(first, second, self.within, |timestamp, a, b| {
                    output.put(first_slots, a.iter().copied());
                    output.put(second_slots, b.iter().copied());
                    output.give(Some(timestamp), sink);
                });
                output.counters.unpaired += lonely;
            }
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

impl Output {
    /// Reads the polled temperatures once: what cannot be read while the buffers run is found here.
    fn new(numbers: usize, columns: usize, temperatures: Vec<Temperature>) -> Result<Self, IioError> {
        let mut celsius = vec![f64::NAN; temperatures.len()];
        let mut polled_ns = None;
        for (place, temperature) in celsius.iter_mut().zip(&temperatures) {
            if let Temperature::Polled(polled) = temperature {
                *place = polled.read().map_err(|error| polled.failed(&error))?;
                polled_ns = Some(0);
            }
        }
        Ok(Self {
            numbers: vec![0; numbers].into_boxed_slice(),
            columns,
            temperatures: temperatures.into_boxed_slice(),
            celsius: celsius.into_boxed_slice(),
            polled_ns,
            counters: IioCounters::default(),
        })
    }

    fn poll(&mut self, now_ns: u64) -> Result<(), IioError> {
        for (place, temperature) in self.celsius.iter_mut().zip(&self.temperatures) {
            let Temperature::Polled(polled) = temperature else { continue };
            match polled.read() {
                Ok(celsius) => {
                    *place = celsius;
                    self.polled_ns = Some(now_ns);
                }
                Err(error) if error.raw_os_error() == Some(Errno::NODEV.raw_os_error()) => {
                    return Err(polled.failed(&error));
                }
                Err(_) => self.counters.failed_polls += 1,
            }
        }
        Ok(())
    }

    fn put(&mut self, slots: &[usize], numbers: impl Iterator<Item = i64>) {
        for (slot, number) in slots.iter().zip(numbers) {
            if let Some(place) = self.numbers.get_mut(*slot) {
                *place = number;
            }
        }
    }

    fn give(&mut self, timestamp_ns: Option<i64>, sink: &mut dyn FnMut(Scan<'_>)) {
        for (place, temperature) in self.celsius.iter_mut().zip(&self.temperatures) {
            if let Temperature::Scanned { slot, scale, offset } = temperature {
                *place = self.numbers.get(*slot).map_or(f64::NAN, |raw| celsius(*raw, *scale, *offset));
            }
        }
        self.counters.scans += 1;
        sink(Scan {
            values: self.numbers.get(..self.columns).unwrap_or_default(),
            temperatures: &self.celsius,
            polled_ns: self.polled_ns,
            timestamp_ns,
        });
    }
}
