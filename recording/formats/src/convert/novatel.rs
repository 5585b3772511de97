//! NovAtel's ASCII logs of raw IMU data: `RAWIMU` and `RAWIMUX`, and with short headers `RAWIMUS` and `RAWIMUSX`.
//!
//! Source: NovAtel OEM7 documentation, SPAN logs. A log is `%NAME,header..;body..*CRC` with a short header, `#NAME,..`
//! with a long one. The fields of the body, with X logs `info,type,` first:
//!
//! ```text
//! week, seconds, status, Z accel, -Y accel, X accel, Z gyro, -Y gyro, X gyro
//! ```
//!
//! Accelerometers and gyroscopes are increments over the nominal interval of the IMU's data rate. Z comes first and the
//! sign of Y is reversed: A1, A2, A3 are X, Y, Z with their own signs. The time is that of the body: GPS weeks and
//! seconds, without leap seconds.

use super::text::{BadRows, Fault};
use isotherm_recording::RecordingError;
use isotherm_recording::foreign::Units;
use isotherm_recording::foreign::{ForeignRow, ForeignRows, PLACEHOLDER, placeholder};
use isotherm_shared::wire::AXES;
use isotherm_support::finding::{Finding, name};
use std::io::{BufRead as _, BufReader, Read};

/// The logs, and whether their bodies begin with info and type of the IMU.
const LOGS: [(&str, bool); 4] = [("%RAWIMUSA", false), ("%RAWIMUSXA", true), ("#RAWIMUA", false), ("#RAWIMUXA", true)];
/// Longest line \[bytes\].
const MAX_LINE: u64 = 1 << 16;
/// A week \[ns\].
const WEEK_NS: u64 = 604_800_000_000_000;
/// Bit of the IMU info: the IMU reports an error.
const IMU_ERROR: u8 = 1;
/// Bit of the IMU info: the data are encrypted.
const ENCRYPTED: u8 = 2;

/// Rows of NovAtel's logs.
pub(super) struct NovatelSource {
    source: BufReader<Box<dyn Read>>,
    temperature: Option<f64>,
    line: u64,
    text: Vec<u8>,
    /// The log that is read: the first of [`LOGS`] that comes.
    log: Option<&'static str>,
    others: u64,
    abbreviated: u64,
    errors: u64,
    /// Rows so far, with the bad lines.
    rows: u64,
    bad: BadRows,
}

/// A line that is no row.
enum ForeignMessage {
    OtherLog,
    Abbreviated,
    Bad(Fault, String),
    /// No line can be used.
    Encrypted,
}

/// Whether data that begin with these bytes are such logs.
pub(super) fn is_log(beginning: &[u8]) -> bool {
    let is_log = |line: &[u8]| LOGS.iter().any(|(name, _)| line.starts_with(name.as_bytes()));
    beginning.split(|byte| *byte == b'\n').any(is_log)
}

impl NovatelSource {
    /// Reads from `source`.
    pub(super) fn new(source: Box<dyn Read>, temperature: Option<f64>) -> Self {
        Self {
            source: BufReader::with_capacity(1 << 16, source),
            temperature,
            line: 0,
            text: Vec::new(),
            log: None,
            others: 0,
            abbreviated: 0,
            errors: 0,
            rows: 0,
            bad: BadRows::default(),
        }
    }

    /// The row of a line.
    fn reading(&mut self) -> Result<ForeignRow, ForeignMessage> {
        let broken = |message: &str| ForeignMessage::Bad(Fault::Line, message.to_owned());
        let line = str::from_utf8(&self.text).map_err(|_| broken("bytes that are not text; is the log damaged?"))?;
        let line = line.trim_end();
        match line.chars().next() {
            None | Some('<' | '[') => return Err(ForeignMessage::Abbreviated),
            Some('%' | '#') => {}
            Some(_) => return Err(broken("not a NovAtel log, which begins with % or #")),
        }
        let (content, crc) =
            line.rsplit_once('*').ok_or_else(|| broken("no * and CRC at the end; is the line cut?"))?;
        let stated = Some(crc).filter(|crc| crc.len() == 8).and_then(|crc| u32::from_str_radix(crc, 16).ok());
        let stated = stated.ok_or_else(|| broken("no CRC of 8 hexadecimal digits at the end; is the line cut?"))?;
        let computed = crc32(&content.as_bytes()[1..]);
        if stated != computed {
            let message =
                format!("the CRC is {stated:08x}, but that of the line is {computed:08x}; the line is damaged");
            return Err(ForeignMessage::Bad(Fault::Checksum, message));
        }
        let (header, body) = content.split_once(';').ok_or_else(|| broken("no ; between header and body"))?;
        let name = header.split(',').next().unwrap_or_default();
        let Some((log, extended)) = LOGS.iter().find(|(log, _)| *log == name) else {
            return Err(ForeignMessage::OtherLog);
        };
        if *self.log.get_or_insert(log) != *log {
            return Err(ForeignMessage::OtherLog);
        }
        let mut fields = body.split(',');
        if *extended {
            let info = fields.next().and_then(|info| u8::from_str_radix(info, 16).ok());
            let info = info.ok_or_else(|| broken("the IMU info is not a hexadecimal number"))?;
            if info & ENCRYPTED != 0 {
                return Err(ForeignMessage::Encrypted);
            }
            self.errors += u64::from(info & IMU_ERROR != 0);
            fields.next();
        }
        let week: Option<u64> = fields.next().and_then(|week| week.parse().ok());
        let ns = fields.next().and_then(|seconds| super::decimal::decimal_ns(seconds, 9)).filter(|ns| *ns < WEEK_NS);
        let time = week.zip(ns).and_then(|(week, ns)| week.checked_mul(WEEK_NS)?.checked_add(ns));
        let timestamp_ns = Some(time.ok_or_else(|| broken("no GPS week and seconds of it"))?);
        let mut counts = [0_i64; 2 * AXES];
        let mut rest = fields.skip(1);
        for count in &mut counts {
            let field = rest.next().and_then(|field| field.parse::<i32>().ok());
            *count = field.ok_or_else(|| broken("not six counts from -2147483648 to 2147483647"))?.into();
        }
        if rest.next().is_some() {
            return Err(broken("more fields than the log has"));
        }
        let [az, ay, ax, gz, gy, gx] = counts;
        let temperature = [self.temperature.unwrap_or(PLACEHOLDER); 2 * AXES];
        let pulses = [ax, -ay, az, gx, -gy, gz];
        Ok(ForeignRow {
            place: self.line,
            timestamp_ns,
            pulses,
            head: temperature,
            board: temperature,
            ..ForeignRow::default()
        })
    }
}

impl ForeignRows for NovatelSource {
    fn read(&mut self) -> Result<Option<ForeignRow>, RecordingError> {
        loop {
            self.text.clear();
            self.line += 1;
            if (&mut self.source).take(MAX_LINE).read_until(b'\n', &mut self.text)? == 0 {
                self.line -= 1;
                return self.bad.check(self.rows).map(|()| None);
            }
            match self.reading() {
                Ok(reading) => {
                    self.rows += 1;
                    return Ok(Some(reading));
                }
                Err(ForeignMessage::OtherLog) => self.others += 1,
                Err(ForeignMessage::Abbreviated) => self.abbreviated += 1,
                Err(ForeignMessage::Bad(fault, message)) => {
                    self.rows += 1;
                    self.bad.take(fault, self.line, message, self.rows)?;
                }
                Err(ForeignMessage::Encrypted) => {
                    let message = "the data are encrypted (IMU info), and cannot be used".to_owned();
                    return Err(self.error(self.line, message));
                }
            }
        }
    }

    fn error(&self, place: u64, message: String) -> RecordingError {
        RecordingError::Data { line: if place == 0 { self.line.max(1) } else { place }, message }
    }

    fn unit(&self) -> Option<&'static str> {
        None
    }

    fn units(&self) -> Result<Units, String> {
        Err("the counts of these logs are increments, whose unit is that of the IMU's type; make the table by hand"
            .to_owned())
    }

    fn has_gyroscopes(&self) -> bool {
        true
    }

    fn has_temperature(&self) -> bool {
        false
    }

    fn notes(&self) -> Vec<String> {
        let mut notes = vec![format!("{}: A1, A2, A3 are X, Y, Z of the IMU", self.log.unwrap_or_default())];
        if self.others + self.abbreviated > 0 {
            notes.push(format!("{} other logs and {} other lines left out", self.others, self.abbreviated));
        }
        notes
    }

    fn findings(&self) -> Vec<Finding> {
        let message = || format!("in {} rows the IMU reports an error (IMU info, bit 0)", self.errors);
        let errors = (self.errors > 0).then(|| Finding::warning(name::IMU_ERROR, message()));
        errors
            .into_iter()
            .chain(self.bad.finding(self.rows, |line| self.name(line)))
            .chain(placeholder(self.temperature))
            .collect()
    }
}

/// NovAtel's CRC32: polynomial 0xEDB88320 reflected, from 0, without inversion at the end.
fn crc32(bytes: &[u8]) -> u32 {
    // The crate's CRC inverts at both ends; its initial value is a finished CRC.
    let mut hasher = crc32fast::Hasher::new_with_initial(u32::MAX);
    hasher.update(bytes);
    hasher.finalize() ^ u32::MAX
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The examples of NovAtel's documentation.
    const EXAMPLES: [&str; 3] = [
        "%RAWIMUSA,2209,491612.254;2209,491612.253588,ea5afe00,329303960,-2512321,4410363,309705,607017,-1009773*1fb76c28",
        "%RAWIMUSXA,2209,491674.014;04,41,2209,491674.013699,ea59fe00,329308016,-2706935,4508389,196192,417138,-1000837*038422a7",
        "#RAWIMUXA,USB1,0,64.5,FINESTEERING,2209,491740.110,02000020,0dc5,16809;04,41,2209,491740.109817,ea57fe00,329394068,-2396829,4481425,321199,257329,-936077*cf9c035d",
    ];

    fn read(text: String) -> Result<Vec<ForeignRow>, String> {
        let mut source = NovatelSource::new(Box::new(std::io::Cursor::new(text)), Some(20.0));
        let mut readings = Vec::new();
        while let Some(reading) = source.read().map_err(|error| error.to_string())? {
            readings.push(reading);
        }
        Ok(readings)
    }

    #[test]
    fn the_vendors_examples_are_read_and_the_sign_of_y_is_restored() {
        let week = 2209 * WEEK_NS;
        let expected = [
            (491_612_253_588_000, [4_410_363, 2_512_321, 329_303_960, -1_009_773, -607_017, 309_705]),
            (491_674_013_699_000, [4_508_389, 2_706_935, 329_308_016, -1_000_837, -417_138, 196_192]),
            (491_740_109_817_000, [4_481_425, 2_396_829, 329_394_068, -936_077, -257_329, 321_199]),
        ];
        for (example, (ns, pulses)) in EXAMPLES.into_iter().zip(expected) {
            assert!(is_log(format!("<OK\r\n{example}").as_bytes()));
            let readings = read(format!("<OK\r\n[COM1]\r\n{example}\r\n")).unwrap();
            assert_eq!(readings.len(), 1);
            assert_eq!((readings[0].timestamp_ns, readings[0].pulses, readings[0].place), (Some(week + ns), pulses, 3));
            assert_eq!((readings[0].head, readings[0].board), ([20.0; 6], [20.0; 6]));
        }
        // Only the first log that comes is read.
        assert_eq!(read(EXAMPLES.join("\n")).unwrap().len(), 1);
    }

    #[test]
    fn a_broken_line_is_an_error_with_its_number() {
        let sealed = |content: &str| format!("{content}*{:08x}\n", crc32(&content.as_bytes()[1..]));
        let [good, ..] = EXAMPLES;
        let broken = |line: &str| read(format!("{good}\n{line}")).unwrap_err();
        assert!(broken(&good.replace("309705", "309706")).starts_with("line 2: the CRC is 1fb76c28, but that of"));
        for cut in 1..good.len() {
            assert!(broken(&good[..cut]).starts_with("line 2: no "), "{cut}");
        }
        assert!(broken("12,13\n").starts_with("line 2: not a NovAtel log"));
        let body = "2209,491612.3,ea5afe00,1,2,3,4,5";
        assert!(broken(&sealed(&format!("%RAWIMUSA,2209,1;{body}"))).starts_with("line 2: not six counts"));
        assert!(broken(&sealed(&format!("%RAWIMUSA,2209,1;{body},2147483648"))).starts_with("line 2: not six counts"));
        assert!(broken(&sealed(&format!("%RAWIMUSA,2209,1;{body},6,7"))).starts_with("line 2: more fields"));
        assert!(broken(&sealed("%RAWIMUSA,2209,1;2209,604800,0,1,2,3,4,5,6")).starts_with("line 2: no GPS week"));
        assert!(broken(&sealed("%RAWIMUSA,2209,1;99999999999,1,0,1,2,3,4,5,6")).starts_with("line 2: no GPS week"));
        assert!(broken(&sealed("%RAWIMUSA,2209,1")).starts_with("line 2: no ; between"));
        assert_eq!(read(format!("{good}\n{}", sealed("%INSPVASA,2209,1;1,2"))).unwrap().len(), 1);
        let extended = |info: &str| read(sealed(&format!("%RAWIMUSXA,2209,1;{info},41,{body},6")));
        assert!(extended("02").unwrap_err().contains("encrypted"));
        assert!(extended("zz").unwrap_err().contains("IMU info"));
        assert_eq!(extended("01").unwrap().len(), 1);
        // Few bad lines among many are left out.
        let many = format!("{good}\n").repeat(60);
        let spoilt = many.replacen("309705", "309706", 1);
        let mut source = NovatelSource::new(Box::new(std::io::Cursor::new(spoilt)), Some(20.0));
        assert_eq!(std::iter::from_fn(|| source.read().unwrap()).count(), 59);
        let told = source.findings()[0].message.clone();
        assert!(
            told.starts_with("1 row is left out of 60: 1 with a wrong checksum; the first is line 1: the CRC"),
            "{told}"
        );
        let message = read(many.replacen("309705", "309706", 2)).unwrap_err();
        assert!(message.contains("; 2 of the 60 rows are bad (2 with a wrong checksum), and at most 1 %"), "{message}");
        assert!(read("\u{e9}%\n".to_owned()).unwrap_err().starts_with("line 1: not a NovAtel log"));
    }
}
