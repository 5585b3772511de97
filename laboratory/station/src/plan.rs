//! A campaign plan for a simulated station.

use crate::station::{ChamberProtocol, SimulatedStation, StationImu, TurntableProtocol};
use isotherm_simulation::Truth;

impl SimulatedStation {
    /// The text of a campaign plan with this station's instruments. `truths` are those of its IMUs; `None` without one.
    #[must_use]
    pub fn plan_toml(&self, truths: &[Truth]) -> Option<String> {
        let truth = truths.first()?;
        let content = truth.table.content();
        let quoted = |text: &str| toml::Value::from(text).to_string();
        let chamber: &str = self.chamber.into();
        let table: &str = self.table.into();
        let wrap = if self.wrap { "wrap = true\n" } else { "" };
        let table_keys = match self.table {
            TurntableProtocol::Acutrol if self.table_port.starts_with("tcp://") => "gap_s = 0.005\n",
            TurntableProtocol::Acutrol => "",
            TurntableProtocol::Aerosmith => "fault_mask = 4\n",
        };
        let chamber_keys = match self.chamber {
            ChamberProtocol::Espec => "",
            // A simulated line needs no pause.
            ChamberProtocol::WatlowF4t => "pause_s = 0\n",
            ChamberProtocol::Ascii2 => "alarm_bit = 2\n",
        };
        let latitude =
            content.gyroscopes.as_ref().map_or(String::new(), |_| format!("latitude_deg = {:?}\n", self.latitude_deg));
        let turns = if content.gyroscopes.is_some() { "[turns]\n\n" } else { "" };
        let serial_of = |truth: &Truth| truth.table.content().serial.as_ref().map(|serial| quoted(serial));
        let (imus, install) = match &self.imus[..] {
            [StationImu { id, .. }] => {
                let serial = serial_of(truth).map_or(String::new(), |serial| format!("serial = {serial}\n"));
                (format!("imu = \"{id}\"\n{serial}"), format!("install = \"{id}.toml\"\n"))
            }
            imus => {
                let items = imus.iter().zip(truths).map(|(StationImu { id, mounting, .. }, truth)| {
                    let serial = serial_of(truth).map_or(String::new(), |serial| format!("serial = {serial}, "));
                    format!("    {{ id = \"{id}\", {serial}mounting = {mounting:?}, install = \"{id}.toml\" }},\n")
                });
                (format!("imus = [\n{}]\n", items.collect::<String>()), String::new())
            }
        };
        let temperature = self.chain.temperature_slope.abs();
        Some(format!(
            "# The campaign at this simulated station: isotherm campaign run --speed {} plan.toml\n\
             format = 1\n{imus}output = \"campaign\"\n\
             gravity_reference = {:?}\ngravity_local = {:?}\n{latitude}temperature_unit = {}\n\
             positions = \"six-faces-two-headings\"\n{install}\n\
             [set_points]\nstart_c = -25\nstop_c = 45\nstep_c = 5\n\n\
             [soak]\ntime_s = 3600\nstay_s = 4200\nwindow_s = 900\nchamber_c_per_h = 2\ntemperature_per_h = {:?}\n\n\
             [dwell]\ntime_s = 300\nrow_s = 10\n\n{turns}\
             [chamber]\ndriver = \"{chamber}\"\nport = {}\n{chamber_keys}ramp_c_per_min = 1\ntolerance_c = 0.5\n\n\
             [turntable]\ndriver = \"{table}\"\nport = {}\n{table_keys}{wrap}rate_deg_s = 10\nacceleration_deg_s2 = 10\n\
             tolerance_deg = 0.005\nstill_deg_s = 0.01\nsettle_s = 10\n\n\
             [limits]\nchamber_c = [-30, 50]\nouter_deg = [-5, 365]\ninner_deg = [-5, 365]\n\n\
             [safe]\nchamber = \"standby\"\n\n\
             [verify]\nruns = 2\nattitudes_deg = [[50, 130], [230, 130]]\nfrom_c = -25\nto_c = 45\nramp_c_per_h = 20\nhold_s = 1800\n",
            self.speed,
            content.gravity,
            self.gravity_local,
            quoted(&content.temperature_unit),
            // 0.75 degC/h.
            (temperature * 750.0).round() / 1000.0,
            quoted(&self.chamber_port),
            quoted(&self.table_port),
        ))
    }
}
