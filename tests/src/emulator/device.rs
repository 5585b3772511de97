//! An emulated device that hears what is sent to it.

use super::Emulator;
use super::answers::Reaction;
use super::answers::mtdata2::Mtdata2;
use super::answers::stim300::Stim300;
use super::answers::vn100::Vn100;
use super::plan::Plan;

/// An emulated device that hears what is sent to it.
pub struct Device {
    mind: Mind,
    /// Frames that are not sent, since an answer took their place.
    replaced: u64,
    rate: Option<f64>,
}

enum Mind {
    Stim300(Stim300),
    Vn100(Vn100),
    Mtdata2(Mtdata2),
    /// It answers nothing.
    Deaf,
}

impl Device {
    /// A device as a plan orders it.
    pub fn new(plan: &Plan) -> Self {
        let (serial, is_new) = (plan.serial.as_str(), plan.is_new);
        let mind = match plan.emulator {
            _ if !plan.answers => Mind::Deaf,
            Emulator::Stim300 => Mind::Stim300(Stim300::new(serial, "1", is_new)),
            Emulator::Stim300Rate => Mind::Stim300(Stim300::new(serial, "2", is_new)),
            Emulator::Vn100 => Mind::Vn100(Vn100::new(serial, is_new)),
            Emulator::Mtdata2 => Mind::Mtdata2(Mtdata2::new(serial, is_new)),
            Emulator::Kvh1750 | Emulator::Arduino => Mind::Deaf,
        };
        Self { mind, replaced: 0, rate: None }
    }

    /// Hears something. Returns what it answers.
    pub fn hear(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut answer = Vec::new();
        for byte in bytes {
            let reaction = match &mut self.mind {
                Mind::Stim300(device) => device.hear(*byte),
                Mind::Vn100(device) => device.hear(*byte),
                Mind::Mtdata2(device) => device.hear(*byte),
                Mind::Deaf => Reaction::default(),
            };
            answer.extend(reaction.write);
            self.replaced += reaction.replaced;
            self.rate = reaction.rate.or(self.rate);
            if let Some(what) = reaction.stored {
                eprintln!("emulator: {what} is kept for good");
            }
        }
        answer
    }

    /// The rate that was ordered since the last call \[Hz\].
    pub fn take_rate(&mut self) -> Option<f64> {
        self.rate.take()
    }

    /// It starts again.
    pub fn reset(&mut self) {
        match &mut self.mind {
            Mind::Stim300(device) => device.reset(),
            Mind::Vn100(device) => device.reset(),
            Mind::Mtdata2(device) => device.reset(),
            Mind::Deaf => {}
        }
    }

    /// What it sends in the place of a frame: that, something else, or nothing.
    pub fn frame(&mut self, frame: Vec<u8>) -> Vec<u8> {
        if self.replaced > 0 {
            self.replaced -= 1;
            return Vec::new();
        }
        let (sends, beside) = match &self.mind {
            Mind::Stim300(device) => (device.sends(), Vec::new()),
            Mind::Vn100(device) => (device.sends(), device.beside()),
            Mind::Mtdata2(device) => (device.sends(), Vec::new()),
            Mind::Deaf => (true, Vec::new()),
        };
        if sends { [frame, beside].concat() } else { beside }
    }
}
