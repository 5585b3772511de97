//! Watlow F4T: Modbus RTU, holding registers.
//!
//! A temperature is a 32-bit float in two registers, the low word first unless `word_order` says otherwise. Its unit is
//! that of the controller's Modbus map; the driver reads the unit and assumes none. How a chamber is started and
//! stopped depends on its maker; by default the driver sets the loop's control mode to automatic or off.

use super::fault::{FaultKind, InstrumentFault};
use super::instrument::{ChamberInstrument, ChamberReading, Instrument, whole_reading};
use super::line::Line;
use super::reply::{ExchangeError, Framing};
use isotherm_shared::document::Section;
use rmodbus::client::ModbusRequest;
use rmodbus::{ErrorKind, ModbusProto};

/// Silence that this controller needs before a request \[s\].
pub const PAUSE_S: f64 = 0.03;

/// Registers of loop 1, and the offset from one loop to the next.
const CONTROL_MODE: u16 = 2730;
const SET_POINT: u16 = 2782;
const ACTUAL_MODE: u16 = 2814;
const PROCESS_VALUE: u16 = 2820;
const LOOP_STEP: u16 = 160;
/// Register with the state of alarm 1, and the offset from one alarm to the next.
const ALARM: u16 = 1356;
const ALARM_STEP: u16 = 100;
/// States that mean no alarm: startup, none, and a third one that public drivers treat the same.
const NO_ALARM: [u16; 3] = [88, 61, 12];
/// Register with the unit of the Modbus map, and its two values.
const UNIT: u16 = 14080;
const UNIT_C: u16 = 15;
const UNIT_F: u16 = 30;
/// Values of the control mode.
const AUTO: u16 = 10;
const OFF: u16 = 62;
const MANUAL: u16 = 54;

/// Keys of this driver.
#[derive(Clone, Debug, PartialEq)]
pub struct F4tSettings {
    /// Modbus address.
    pub address: u8,
    /// Added to the registers of loop 1.
    pub offset: u16,
    /// Whether the low word of a float comes first.
    pub low_word_first: bool,
    /// Register that starts and stops the chamber, value that starts it, value that stops it.
    pub start: [u16; 3],
    /// Register with the running state, and its value while the chamber is stopped.
    pub stopped: [u16; 2],
    /// Its value while the chamber runs; `None` if every other value than that of a stopped one means it.
    pub running: Option<u16>,
    /// Number of alarms that are read.
    pub alarms: u16,
}

impl F4tSettings {
    pub(super) fn read(section: &Section<'_, '_>) -> Self {
        let register =
            |key, default: u16| section.optional_integer(key, 0..=65535).map_or(default, |value| value as u16);
        let offset = LOOP_STEP * (section.optional_integer("loop", 1..=4).unwrap_or(1) as u16 - 1);
        let stopped = [register("state_register", ACTUAL_MODE + offset), register("state_stopped", OFF)];
        // What another register says while the chamber runs is not known.
        let running = (stopped == [ACTUAL_MODE + offset, OFF]).then_some(AUTO);
        let running = section.optional_integer("state_running", 0..=65535).map(|value| value as u16).or(running);
        Self {
            address: section.optional_integer("address", 1..=247).unwrap_or(1) as u8,
            offset,
            low_word_first: section
                .optional_choice("word_order", &[(true, "low-first"), (false, "high-first")])
                .unwrap_or(true),
            start: [
                register("start_register", CONTROL_MODE + offset),
                register("start_value", AUTO),
                register("stop_value", OFF),
            ],
            stopped,
            running,
            alarms: section.optional_integer("alarms", 0..=14).unwrap_or(4) as u16,
        }
    }

    fn float(&self, [first, second]: [u16; 2]) -> f32 {
        let (low, high) = if self.low_word_first { (first, second) } else { (second, first) };
        f32::from_bits(u32::from(high) << 16 | u32::from(low))
    }

    fn words(&self, number: f32) -> [u16; 2] {
        let (high, low) = ((number.to_bits() >> 16) as u16, number.to_bits() as u16);
        if self.low_word_first { [low, high] } else { [high, low] }
    }
}

/// What the chamber does.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
enum ChamberState {
    Running,
    Stopped,
    /// Neither: the value of its state.
    Other(u16),
}

/// The name of a control mode.
fn mode_name(mode: u16) -> String {
    if mode == MANUAL { format!("manual mode ({MANUAL})") } else { format!("mode {mode}") }
}

/// The driver.
pub struct F4t {
    line: Line,
    settings: F4tSettings,
    /// Unit of the Modbus map, once it is known.
    fahrenheit: Option<bool>,
}

/// Length of the reply to `request`: five bytes for an exception, otherwise as the function defines it. `None` while it
/// is incomplete.
fn reply_length(request: &[u8], reply: &[u8]) -> Option<usize> {
    let function = *reply.get(1)?;
    let length = match function {
        _ if function & 0x80 != 0 => 5,
        3 => 5 + usize::from(*reply.get(2)?),
        _ => 8,
    };
    // A reply of another function or address never counts as complete: at the time-out it is garbled.
    let matches = request.first() == reply.first() && request.get(1) == Some(&(function & 0x7f));
    (matches && reply.len() >= length).then_some(length)
}

impl F4t {
    pub(super) fn new(line: Line, settings: &F4tSettings) -> Self {
        Self { line, settings: settings.clone(), fahrenheit: None }
    }

    fn ask<T>(
        &mut self,
        generate: impl Fn(&mut ModbusRequest, &mut Vec<u8>) -> Result<(), ErrorKind>,
        read: impl Fn(&ModbusRequest, &[u8]) -> Result<T, ErrorKind>,
    ) -> Result<T, InstrumentFault> {
        let (mut modbus, mut request) = (ModbusRequest::new(self.settings.address, ModbusProto::Rtu), Vec::new());
        let generated = generate(&mut modbus, &mut request);
        generated.map_err(|error| {
            self.line.fault(ExchangeError(FaultKind::Refused, format!("making the request: {error}")))
        })?;
        let framing = Framing { reply_length: &|reply| reply_length(&request, reply), gap: None };
        self.line.ask(&request, framing, |reply| {
            read(&modbus, reply).map_err(|error| match error {
                ErrorKind::FrameBroken | ErrorKind::FrameCRCError | ErrorKind::OOB => ExchangeError::garbled(reply),
                exception => ExchangeError(FaultKind::Refused, format!("Modbus exception, {exception}")),
            })
        })
    }

    fn registers<const N: usize>(&mut self, register: u16) -> Result<[u16; N], InstrumentFault> {
        let count = N as u16;
        self.ask(
            |modbus, request| modbus.generate_get_holdings(register, count, request),
            |modbus, reply| {
                let mut values = Vec::new();
                modbus.parse_u16(reply, &mut values)?;
                values.try_into().map_err(|_| ErrorKind::FrameBroken)
            },
        )
    }

    /// Writes registers and checks the reply: it repeats the request's register, and its value (one register) or count
    /// (several).
    fn write(&mut self, register: u16, values: &[u16]) -> Result<(), InstrumentFault> {
        let echo = match *values {
            [value] => [register, value],
            _ => [register, values.len() as u16],
        };
        let echo = echo.map(u16::to_be_bytes).concat();
        self.ask(
            |modbus, request| match *values {
                [value] => modbus.generate_set_holding(register, value, request),
                _ => modbus.generate_set_holdings_bulk(register, values, request),
            },
            |modbus, reply| {
                modbus.parse_ok(reply)?;
                (reply.get(2..6) == Some(&echo[..])).then_some(()).ok_or(ErrorKind::FrameBroken)
            },
        )
    }

    fn fahrenheit(&mut self) -> Result<bool, InstrumentFault> {
        if let Some(known) = self.fahrenheit {
            return Ok(known);
        }
        let [unit] = self.registers(UNIT)?;
        let fahrenheit = match unit {
            UNIT_C => false,
            UNIT_F => true,
            other => {
                let message = format!("register {UNIT}, the unit, is {other}, not {UNIT_C} (C) or {UNIT_F} (F)");
                return Err(self.line.fault(ExchangeError(FaultKind::Mismatch, message)));
            }
        };
        // The reply to an order may belong to another request.
        if !self.line.has_orders() {
            self.fahrenheit = Some(fahrenheit);
        }
        Ok(fahrenheit)
    }

    fn temperature(&mut self, register: u16) -> Result<f64, InstrumentFault> {
        let fahrenheit = self.fahrenheit()?;
        let words = self.registers(register + self.settings.offset)?;
        let number = f64::from(self.settings.float(words));
        if number.is_nan() || number.abs() >= 1000.0 {
            let message = format!("register {register} is {number:e}; try the other word_order");
            return Err(self.line.fault(ExchangeError(FaultKind::Mismatch, message)));
        }
        Ok(if fahrenheit { (number - 32.0) / 1.8 } else { number })
    }

    fn alarms(&mut self) -> Result<Vec<String>, InstrumentFault> {
        let mut alarms = Vec::new();
        for index in 0..self.settings.alarms {
            let [state] = self.registers(ALARM + ALARM_STEP * index)?;
            if !NO_ALARM.contains(&state) {
                alarms.push(format!("alarm {}, state {state}", index + 1));
            }
        }
        Ok(alarms)
    }

    fn state(&mut self) -> Result<ChamberState, InstrumentFault> {
        let [register, stopped] = self.settings.stopped;
        let [state] = self.registers(register)?;
        Ok(match self.settings.running {
            _ if state == stopped => ChamberState::Stopped,
            Some(running) if state != running => ChamberState::Other(state),
            _ => ChamberState::Running,
        })
    }

    /// Starts or stops the chamber and checks its state.
    fn switch(&mut self, value: u16, running: bool) -> Result<(), InstrumentFault> {
        let [register, ..] = self.settings.start;
        self.write(register, &[value])?;
        let state = self.state()?;
        if state == if running { ChamberState::Running } else { ChamberState::Stopped } {
            return Ok(());
        }
        let is = match state {
            ChamberState::Running => "still runs".to_owned(),
            ChamberState::Stopped => "does not run".to_owned(),
            ChamberState::Other(mode) => format!("is in {}", mode_name(mode)),
        };
        let message = format!("it {is} after {value} was written to register {register}");
        let alarms = self.alarms()?;
        Err(self.line.fault(match alarms.is_empty() {
            true => ExchangeError(FaultKind::Mismatch, message),
            false => ExchangeError(FaultKind::Alarm, format!("{}; {message}", alarms.join(", "))),
        }))
    }
}

impl Instrument for F4t {
    fn line_mut(&mut self) -> &mut Line {
        &mut self.line
    }

    /// Public drivers know no register with the controller's part number.
    fn identify(&mut self) -> Result<String, InstrumentFault> {
        let unit = if self.fahrenheit()? { "F" } else { "C" };
        let number = self.settings.offset / LOOP_STEP + 1;
        Ok(format!("Watlow F4T, address {}, loop {number}, unit {unit}", self.settings.address))
    }
}

impl ChamberInstrument for F4t {
    fn read(&mut self) -> Result<ChamberReading, InstrumentFault> {
        // A late reply shows in the number of registers: two of a temperature, one of everything else.
        whole_reading(self, |chamber| {
            let [air_c, set_point_c] = [chamber.temperature(PROCESS_VALUE)?, chamber.temperature(SET_POINT)?];
            let state = chamber.state()?;
            let other_mode = match state {
                ChamberState::Other(mode) => Some(mode_name(mode)),
                ChamberState::Running | ChamberState::Stopped => None,
            };
            Ok(ChamberReading {
                air_c,
                set_point_c,
                running: state == ChamberState::Running,
                other_mode,
                alarms: chamber.alarms()?,
            })
        })
    }

    fn set_point(&mut self, celsius: f64) -> Result<(), InstrumentFault> {
        let fahrenheit = match self.fahrenheit() {
            Ok(fahrenheit) => fahrenheit,
            // Without the unit only the stop can be ordered.
            Err(fault) if self.line.has_orders() => return self.standby().and(Err(fault)),
            Err(fault) => return Err(fault),
        };
        let number = if fahrenheit { celsius * 1.8 + 32.0 } else { celsius };
        let words = self.settings.words(number as f32);
        self.write(SET_POINT + self.settings.offset, &words)?;
        let now = self.temperature(SET_POINT)?;
        if (now - celsius).abs() < 0.01 {
            return Ok(());
        }
        Err(self.line.fault(ExchangeError(
            FaultKind::Mismatch,
            format!("its set point is {now:.2} degC after {celsius:.2} was written"),
        )))
    }

    fn run(&mut self) -> Result<(), InstrumentFault> {
        self.switch(self.settings.start[1], true)
    }

    fn standby(&mut self) -> Result<(), InstrumentFault> {
        self.switch(self.settings.start[2], false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::line_config::settings_of;

    fn settings(toml: &str) -> F4tSettings {
        settings_of(toml, F4tSettings::read)
    }

    // Word order as in StaflSystems/ChamberConnectLibrary, chamberconnectlibrary/modbus.py, with low_word_first True
    // and False.
    #[test]
    fn floats_have_the_word_order_of_the_settings() {
        assert_eq!(settings("").words(25.5), [0x0000, 0x41cc]);
        assert_eq!(settings("word_order = \"high-first\"").words(-40.0), [0xc220, 0x0000]);
        for order in ["low-first", "high-first"] {
            let settings = settings(&format!("word_order = \"{order}\""));
            assert_eq!(settings.float(settings.words(-25.3)), -25.3);
        }
    }

    // The first two frames are the usual examples of the Modbus literature for functions 3 and 16. The CRC of 02 07 is
    // the example of the specification.
    #[test]
    fn frames_are_those_of_modbus_rtu() {
        let (mut modbus, mut request) = (ModbusRequest::new(0x11, ModbusProto::Rtu), Vec::new());
        modbus.generate_get_holdings(0x6b, 3, &mut request).unwrap();
        assert_eq!(request, [0x11, 3, 0, 0x6b, 0, 3, 0x76, 0x87]);
        modbus.generate_set_holdings_bulk(1, &[10, 258], &mut request).unwrap();
        assert_eq!(request, [0x11, 16, 0, 1, 0, 2, 4, 0, 10, 1, 2, 0xc6, 0xf0]);
        let mut modbus = ModbusRequest::new(1, ModbusProto::Rtu);
        modbus.generate_set_holdings_bulk(SET_POINT, &settings("").words(25.5), &mut request).unwrap();
        assert_eq!(request[..11], [1, 16, 0x0a, 0xde, 0, 2, 4, 0, 0, 0x41, 0xcc]);
        assert_eq!((crc(&request), crc(&[0x02, 0x07])), (0, 0x1241));
    }

    /// CRC-16 of Modbus, bit by bit. Over a frame with its CRC it is 0.
    fn crc(bytes: &[u8]) -> u16 {
        bytes.iter().fold(0xffff, |crc, byte| {
            (0..8).fold(crc ^ u16::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xa001 } else { crc >> 1 })
        })
    }

    #[test]
    fn a_reply_ends_where_its_function_says() {
        let read = [1, 3, 0, 0, 0, 2];
        assert_eq!(reply_length(&read, &[1, 3, 4, 0, 0, 0, 0, 9]), None);
        assert_eq!(reply_length(&read, &[1, 3, 4, 0, 0, 0, 0, 9, 9, 7]), Some(9));
        assert_eq!(reply_length(&read, &[1, 0x83, 2, 9, 9]), Some(5));
        assert_eq!(reply_length(&read, &[1, 6, 0, 0, 0, 0, 9, 9]), None);
        assert_eq!(reply_length(&read, &[2, 3, 4, 0, 0, 0, 0, 9, 9]), None);
    }
}
