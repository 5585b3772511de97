//! What emulated devices answer, from the makers' data sheets. What a device does not know it refuses as its data sheet
//! says, or not at all.

pub(super) mod mtdata2;
pub(super) mod stim300;
pub(super) mod vn100;

/// What a device does about an order that it has received.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Reaction {
    /// What it writes at once.
    pub(super) write: Vec<u8>,
    /// Frames that are not sent, since its answer takes their place.
    pub(super) replaced: u64,
    /// The rate at which it samples from now on \[Hz\].
    pub(super) rate: Option<f64>,
    /// What it keeps for good.
    pub(super) stored: Option<String>,
}

impl Reaction {
    pub(super) fn writes(write: Vec<u8>) -> Self {
        Self { write, ..Self::default() }
    }
}
