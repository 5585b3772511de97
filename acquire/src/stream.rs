//! A stream of bytes, decoded as a description says.

use crate::description::{Description, Kind};
use crate::frames::{DecodedFrame, Decoder, FrameArrival};
use crate::lines::LineDecoder;
use crate::tally::SkippedBytes;

/// Finds the frames or lines of a description in a stream of bytes.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_acquire::{FrameArrival, Description, StreamDecoder};
///
/// let description = Description::from_toml(include_str!("../../examples/acquire/arduino-mpu6050.toml"))?;
/// let mut decoder = StreamDecoder::new(&description).ok_or("IIO has no stream")?;
/// let mut rows = 0;
/// decoder.push(b"$IMU,1,5000,1,2,8192,24.5,3,4,5*67\n$IMU,2,10", FrameArrival::default(), &mut |_| rows += 1);
/// decoder.end();
/// assert_eq!((rows, decoder.skipped().cut), (1, 9));
/// # Ok(())
/// # }
/// ```
pub struct StreamDecoder(Form);

enum Form {
    Frames(Box<Decoder>),
    Lines(LineDecoder),
}

impl StreamDecoder {
    /// A decoder at the beginning of a stream; `None` for IIO, which has scans, and for messages.
    #[must_use]
    pub fn new(description: &Description) -> Option<Self> {
        match &description.kind {
            Kind::Frames(_, frame) => Some(Self(Form::Frames(Box::new(Decoder::new((**frame).clone()))))),
            Kind::Lines(_, line) => Some(Self(Form::Lines(LineDecoder::new(line.clone())))),
            Kind::Iio(_) | Kind::Messages(..) => None,
        }
    }

    /// Takes the next bytes of the stream, in pieces of any length, and gives each frame that is complete to `sink`.
    /// Allocates nothing.
    pub fn push(&mut self, bytes: &[u8], arrival: FrameArrival, sink: &mut impl FnMut(DecodedFrame<'_>)) {
        match &mut self.0 {
            Form::Frames(decoder) => decoder.push(bytes, arrival, sink),
            Form::Lines(decoder) => decoder.push(bytes, arrival, sink),
        }
    }

    /// Ends the stream: what is left is no frame. Another one may begin.
    pub fn end(&mut self) {
        match &mut self.0 {
            Form::Frames(decoder) => decoder.end(),
            Form::Lines(decoder) => decoder.end(),
        }
    }

    /// Bytes that were no frame, by cause.
    #[must_use]
    pub const fn skipped(&self) -> &SkippedBytes {
        match &self.0 {
            Form::Frames(decoder) => decoder.skipped(),
            Form::Lines(decoder) => decoder.skipped(),
        }
    }
}
