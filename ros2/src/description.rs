//! The description of a node: which IMUs it publishes, and which topics it makes IMUs of.

use crate::topic::{DIAGNOSTICS, OutputTopics, fault, name_of};
use isotherm_acquire::{MessageSettings, MessageStamps, acceleration_units, rate_units};
use isotherm_client::{ImuId, Resolution, device};
use isotherm_shared::document::{Document, Faults, Section};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// One pulse of a reading [m/s2, rad/s] unless given: that of tables which are made of bags.
const RESOLUTION: f64 = 1e-6;
/// By how much the product of a rotation with its transpose may differ from 1.
const ORTHOGONAL: f64 = 1e-6;
/// Messages that a topic keeps unless given.
const DEPTH: usize = 10;
/// What becomes of `use_sim_time`.
pub(crate) const NO_SIMULATED_TIME: &str = "simulated time (use_sim_time) is not followed: stamps are of this machine's \
                                            Unix time; for a driver on another time, as of a bag that is played, give \
                                            clock = \"other\" in [[subscribe]]";
/// The highest domain that ROS 2 has ports for.
const MAX_DOMAIN: i64 = 232;

/// The description of a node.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeDescription {
    /// Its name.
    pub name: String,
    /// Its domain in ROS 2; `None`: that of `ROS_DOMAIN_ID`, or 0.
    pub domain_id: Option<u16>,
    /// How far it is seen; `None`: as the variables of ROS 2 say.
    pub discovery: Option<Discovery>,
    /// Whether it publishes `/diagnostics`.
    pub diagnostics: bool,
    /// The IMUs that it publishes.
    pub outputs: Vec<OutputSettings>,
    /// The topics that it makes IMUs of.
    pub inputs: Vec<InputSettings>,
}

/// How far a node is seen.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Discovery {
    /// On this machine.
    Localhost,
    /// In the networks of this machine.
    Subnet,
}

impl Discovery {
    const NAMES: [(Self, &'static str); 2] = [(Self::Localhost, "localhost"), (Self::Subnet, "subnet")];
}

/// How a topic keeps messages.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct QueueSettings {
    /// Whether a message that was lost is sent again.
    pub is_reliable: bool,
    /// Messages that are kept.
    pub depth: usize,
}

/// What becomes of an increment that is not whole.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum InvalidPolicy {
    /// It is left out.
    Omit,
    /// Its values that are not known are NaN.
    Nan,
}

/// An IMU that is published.
#[derive(Clone, Debug, PartialEq)]
pub struct OutputSettings {
    /// The IMU.
    pub imu: ImuId,
    /// The namespace of its topics.
    pub namespace: String,
    /// The frame of its messages.
    pub frame: String,
    /// Turns vectors of the table's body frame into that frame.
    pub rotation: [[f64; 3]; 3],
    /// File with the noise, as `isotherm noise --kalibr` writes it.
    pub noise: Option<PathBuf>,
    /// What becomes of increments that are not whole.
    pub invalid: InvalidPolicy,
    /// Whether timestamps are of another clock than `CLOCK_MONOTONIC`.
    pub has_other_clock: bool,
    /// How its messages are kept.
    pub queue: QueueSettings,
    /// The temperature \[degC\] that is taken for the driver's of which this node makes the IMU: nobody measures it.
    pub assumed_temperature: Option<f64>,
}

impl OutputSettings {
    /// Of an IMU without more.
    #[must_use]
    pub fn new(imu: ImuId) -> Self {
        let frame = name_of(&imu);
        Self {
            imu,
            namespace: format!("/{frame}"),
            frame,
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            noise: None,
            invalid: InvalidPolicy::Omit,
            has_other_clock: false,
            queue: QueueSettings { is_reliable: true, depth: DEPTH },
            assumed_temperature: None,
        }
    }

    /// The names of its topics.
    #[must_use]
    pub fn topics(&self) -> OutputTopics {
        OutputTopics::of_namespace(&self.namespace)
    }
}

/// Where the temperature of a driver comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum TemperatureOrigin {
    /// A topic of `sensor_msgs/Temperature`.
    Topic(String),
    /// It is always the same \[degC\].
    Constant(f64),
}

/// A driver's topic that becomes an IMU.
#[derive(Clone, Debug, PartialEq)]
pub struct InputSettings {
    /// The topic of `sensor_msgs/Imu`.
    pub topic: String,
    /// Where the temperature comes from.
    pub temperature: TemperatureOrigin,
    /// The only frame whose messages are taken; `None`: any.
    pub frame: Option<String>,
    /// Whether the stamps are of another clock than this machine's Unix time.
    pub has_other_clock: bool,
    /// One of the messages' unit of accelerations \[m/s2\] and of rates \[rad/s\].
    pub units: [f64; 2],
    /// How messages become samples; its temperature is that of `temperature`.
    pub samples: MessageSettings,
    /// What is asked of the driver.
    pub queue: QueueSettings,
}

impl NodeDescription {
    /// Publishes these IMUs, without more.
    #[must_use]
    pub fn of_imus(imus: &[ImuId]) -> Self {
        Self {
            name: "isotherm".to_owned(),
            domain_id: None,
            discovery: None,
            diagnostics: true,
            outputs: imus.iter().cloned().map(OutputSettings::new).collect(),
            inputs: Vec::new(),
        }
    }

    /// Reads the text of a description. Paths in it are relative to `folder`.
    ///
    /// # Errors
    /// Everything that is wrong with it.
    pub fn from_toml(text: &str, folder: &Path) -> Result<Self, Faults> {
        let document = Document::parse_as(text, "give the description of a node of ROS 2")?;
        let root = document.root();
        let description = read(&root, folder);
        root.finish();
        document.finish(description)
    }

    /// One line for people.
    #[must_use]
    pub fn summary(&self) -> String {
        let all = |parts: Vec<String>| parts.join(", ");
        let published = all(self.outputs.iter().map(|output| output.imu.to_string()).collect());
        let heard = self.inputs.iter().map(|input| format!("{} of {}", input.samples.imu, input.topic));
        match (published.is_empty(), all(heard.collect())) {
            (true, heard) => format!("node of ROS 2 that subscribes to {heard}"),
            (false, heard) if heard.is_empty() => format!("node of ROS 2 that publishes {published}"),
            (false, heard) => format!("node of ROS 2 that publishes {published} and subscribes to {heard}"),
        }
    }
}

fn read(root: &Section<'_, '_>, folder: &Path) -> Option<NodeDescription> {
    root.fault_if(!root.has("format"), "format", "missing; give 1");
    root.optional_integer("format", 1..=1);
    let node = NodeDescription::of_imus(&[]);
    let node = root.optional_section("ros2").map_or(node.clone(), |section| of_node(section, node));
    let outputs: Vec<_> = root.list("publish").into_iter().map(|section| output(section, folder)).collect();
    let inputs: Vec<_> = root.list("subscribe").into_iter().map(input).collect();
    let is_empty = outputs.is_empty() && inputs.is_empty();
    root.fault_if(is_empty, "publish", "missing; give [[publish]] with an imu, or [[subscribe]] with imu and topic");
    let mut outputs: Vec<_> = outputs.into_iter().collect::<Option<_>>()?;
    let inputs: Vec<InputSettings> = inputs.into_iter().collect::<Option<_>>()?;
    for output in &mut outputs {
        let input = inputs.iter().find(|input| input.samples.imu == output.imu);
        output.assumed_temperature = input.and_then(|input| input.samples.temperature);
    }
    let node = NodeDescription { outputs, inputs, ..node };
    refuse_conflicts(root, &node);
    Some(node)
}

fn of_node(section: Section<'_, '_>, node: NodeDescription) -> NodeDescription {
    let name = section.optional_string("name").unwrap_or("isotherm");
    let is_name = !name.contains('/') && fault(&format!("/{name}")).is_none();
    section.fault_if(!is_name, "name", "give letters, digits and single underscores, no digit first");
    let domain_id = section.optional_integer("domain_id", 0..=MAX_DOMAIN).map(|id| id as u16);
    let discovery = section.optional_choice("discovery", &Discovery::NAMES);
    let diagnostics = section.optional_bool("diagnostics").unwrap_or(true);
    let is_simulated = section.optional_bool("use_sim_time").unwrap_or(false);
    section.fault_if(is_simulated, "use_sim_time", NO_SIMULATED_TIME);
    section.finish();
    NodeDescription { name: name.to_owned(), domain_id, discovery, diagnostics, ..node }
}

fn queue(section: &Section<'_, '_>, is_reliable: bool) -> QueueSettings {
    let choices = [(true, "reliable"), (false, "best-effort")];
    let is_reliable = section.optional_choice("reliability", &choices).unwrap_or(is_reliable);
    let depth = section.optional_integer("depth", 1..=8192).map_or(DEPTH, |depth| depth as usize);
    QueueSettings { is_reliable, depth }
}

/// The absolute name of a topic or namespace.
fn absolute<'a>(section: &Section<'_, 'a>, key: &'static str, name: Option<&'a str>) -> Option<&'a str> {
    let wrong = name.and_then(fault);
    section.refuse(key, wrong.map(str::to_owned));
    name.filter(|_| wrong.is_none())
}

fn output(section: Section<'_, '_>, folder: &Path) -> Option<OutputSettings> {
    let imu = section.imu_id("imu");
    let namespace = section.optional_string("namespace");
    let wrong = namespace.and_then(fault);
    section.refuse("namespace", wrong.map(str::to_owned));
    let frame = section.optional_string("frame");
    let rotation = section.has("rotation").then(|| rotation(&section));
    let noise = section.optional_string("noise").map(|file| folder.join(file));
    let invalid = section.optional_choice("invalid", &[(InvalidPolicy::Omit, "omit"), (InvalidPolicy::Nan, "nan")]);
    let has_other_clock = section.optional_choice("clock", &[(false, "monotonic"), (true, "other")]);
    let queue = queue(&section, true);
    section.finish();
    let own = OutputSettings::new(imu?);
    Some(OutputSettings {
        namespace: namespace.map_or(own.namespace, str::to_owned),
        frame: frame.map_or(own.frame, str::to_owned),
        rotation: rotation.unwrap_or(Some(own.rotation))?,
        noise,
        invalid: invalid.unwrap_or(own.invalid),
        has_other_clock: has_other_clock.unwrap_or(own.has_other_clock),
        queue,
        assumed_temperature: None,
        imu: own.imu,
    })
}

/// A proper rotation.
fn rotation(section: &Section<'_, '_>) -> Option<[[f64; 3]; 3]> {
    const EXPECTED: &str = "three rows of three numbers, such as [[0, 1, 0], [1, 0, 0], [0, 0, -1]]";
    let rows = section.matrix("rotation", EXPECTED)?;
    let row = |row: &Vec<f64>| <[f64; 3]>::try_from(row.as_slice()).ok();
    let rows = rows.iter().map(row).collect::<Option<Vec<_>>>().and_then(|rows| <[[f64; 3]; 3]>::try_from(rows).ok());
    section.fault_if(rows.is_none(), "rotation", "give three rows of three numbers");
    let rows = rows?;
    let dot = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let [[a, b, c], [d, e, f], [g, h, i]] = rows;
    let determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g);
    let is_orthogonal = (0..3).all(|one| {
        let of = |other: usize| dot(rows[one], rows[other]) - f64::from(u8::from(one == other));
        (0..3).all(|other| of(other).abs() <= ORTHOGONAL)
    });
    let is_right = is_orthogonal && determinant > 0.0;
    let message = "is not a rotation: its rows must be of length 1, at right angles, and right-handed; give more \
                   digits, or another sign";
    section.fault_if(!is_right, "rotation", message);
    is_right.then_some(rows)
}

fn input(section: Section<'_, '_>) -> Option<InputSettings> {
    let imu = section.imu_id("imu");
    let serial = section.optional_string("serial");
    let is_empty = serial.is_some_and(|serial| device(serial) == 0);
    section.fault_if(is_empty, "serial", "is empty; give it, or leave it out");
    let topic = section.string("topic", "the topic of sensor_msgs/Imu that the driver publishes");
    let topic = absolute(&section, "topic", topic);
    let temperature_topic = section.optional_string("temperature_topic");
    let temperature_topic = absolute(&section, "temperature_topic", temperature_topic);
    let constant = section.optional_number("temperature_c");
    let is_right = constant.is_none_or(|constant| constant.is_finite() && (-150.0..250.0).contains(&constant));
    section.fault_if(!is_right, "temperature_c", "give degrees Celsius, from -150 to 250");
    let temperature_max_age_s = section.optional_limit("temperature_max_age_s");
    let is_idle = section.has("temperature_c") && section.has("temperature_max_age_s");
    section.fault_if(is_idle, "temperature_max_age_s", "is there without temperature_topic; leave it out");
    let sources = usize::from(section.has("temperature_topic")) + usize::from(section.has("temperature_c"));
    let missing = "missing; give the topic of sensor_msgs/Temperature, or temperature_c = 25.0 for a driver without \
                   one, whose increments are then those of one temperature";
    section.fault_if(sources == 0, "temperature_topic", missing);
    section.fault_if(sources == 2, "temperature_c", "is given in addition to temperature_topic; leave one out");
    let frame = section.optional_string("frame").map(str::to_owned);
    let interval = section.number("interval_s", "the nominal interval of two messages in s").map(|s| s * 1e9);
    let right = interval.filter(|ns| (1e3..=3.6e12).contains(ns));
    let is_wrong = interval.is_some() && right.is_none();
    section.fault_if(is_wrong, "interval_s", "give a number of seconds from 0.000001 to 3600");
    let kinds = [(MessageStamps::Sample, "sample"), (MessageStamps::Arrival, "arrival")];
    let stamps = section.optional_choice("stamps", &kinds).unwrap_or(MessageStamps::Sample);
    let has_other_clock = section.optional_choice("clock", &[(false, "system"), (true, "other")]).unwrap_or(false);
    let resolution = resolution(&section);
    let has_gyroscopes = section.optional_bool("gyroscopes").unwrap_or(true);
    let has_gravity = section.optional_bool("gravity").unwrap_or(true);
    let unit = |key, units: &[(f64, &str)]| section.optional_choice(key, units).unwrap_or(1.0);
    let units = [unit("accelerometer_unit", &acceleration_units()), unit("gyroscope_unit", &rate_units())];
    let queue = queue(&section, false);
    section.finish();
    let temperature = match (temperature_topic, constant.filter(|_| is_right)) {
        (Some(topic), None) => TemperatureOrigin::Topic(topic.to_owned()),
        (None, Some(constant)) => TemperatureOrigin::Constant(constant),
        _ => return None,
    };
    let (constant, temperature_name) = match &temperature {
        TemperatureOrigin::Topic(topic) => (None, topic.clone()),
        TemperatureOrigin::Constant(constant) => (Some(*constant), String::new()),
    };
    Some(InputSettings {
        topic: topic?.to_owned(),
        temperature,
        frame,
        has_other_clock,
        units,
        samples: MessageSettings {
            imu: imu?,
            serial: serial.map(str::to_owned),
            interval_ns: right?.round() as u64,
            resolution: resolution?,
            stamps,
            has_gyroscopes,
            has_gravity,
            temperature: constant,
            temperature_name,
            temperature_max_age_s,
        },
        queue,
    })
}

/// What a pulse stands for.
fn resolution(section: &Section<'_, '_>) -> Option<Resolution> {
    let of = |key: &'static str| {
        let given = section.optional_number(key).unwrap_or(RESOLUTION);
        let is_right = (1e-12..=1.0).contains(&given);
        section.fault_if(!is_right, key, "give what the table's scale factors are for, from 1e-12 to 1");
        is_right.then_some(given)
    };
    let (accelerometer, gyroscope) = (of("accelerometer_resolution"), of("gyroscope_resolution"));
    Some(Resolution { accelerometer: accelerometer?, gyroscope: gyroscope? })
}

/// An IMU is published once and made once, and no topic is both read and written.
fn refuse_conflicts(root: &Section<'_, '_>, node: &NodeDescription) {
    let mut published = BTreeSet::new();
    if node.diagnostics {
        published.insert(DIAGNOSTICS.to_owned());
    }
    let mut imus = BTreeSet::new();
    for output in &node.outputs {
        let again = (!imus.insert(&output.imu)).then(|| format!("{} is published twice; leave one out", output.imu));
        root.refuse("publish.imu", again);
        for topic in output.topics().all() {
            let message = format!("{topic} would have two publishers; give another namespace");
            let again = !published.insert(topic);
            root.refuse("publish.namespace", again.then_some(message));
        }
    }
    let (mut imus, mut heard) = (BTreeSet::new(), BTreeSet::new());
    for input in &node.inputs {
        let imu = &input.samples.imu;
        let again = (!imus.insert(imu)).then(|| format!("{imu} is made of two topics; leave one out"));
        root.refuse("subscribe.imu", again);
        let topics = match &input.temperature {
            TemperatureOrigin::Topic(topic) => vec![&input.topic, topic],
            TemperatureOrigin::Constant(_) => vec![&input.topic],
        };
        let is_both = topics.iter().find(|topic| published.contains(**topic));
        let message = |topic: &&&String| {
            format!(
                "{topic} is what this node publishes; let the driver publish under another name, or give another namespace"
            )
        };
        root.refuse("subscribe.topic", is_both.as_ref().map(message));
        let again = !heard.insert(&input.topic);
        root.refuse("subscribe.topic", again.then(|| format!("{} would become two IMUs; leave one out", input.topic)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn faults(text: &str) -> String {
        NodeDescription::from_toml(text, Path::new("")).err().map_or(String::new(), |faults| faults.to_string())
    }

    #[test]
    fn every_key_is_read() {
        let text = r#"
            format = 1
            [ros2]
            name = "left"
            domain_id = 7
            discovery = "localhost"
            diagnostics = false
            [[publish]]
            imu = "imu-a"
            namespace = "/left"
            frame = "imu_link"
            rotation = [[0, 1, 0], [1, 0, 0], [0, 0, -1]]
            noise = "imu.yaml"
            invalid = "nan"
            clock = "other"
            reliability = "best-effort"
            depth = 50
            [[subscribe]]
            imu = "imu-a"
            serial = "SN 42"
            topic = "/driver/imu/data_raw"
            temperature_topic = "/driver/imu/temperature"
            temperature_max_age_s = inf
            frame = "imu_link"
            interval_s = 0.0025
            stamps = "arrival"
            clock = "other"
            gyroscopes = false
            gravity = false
            accelerometer_unit = "mg"
            gyroscope_unit = "deg/s"
            gyroscope_resolution = 1e-7
            reliability = "reliable"
            depth = 100
        "#;
        let node = NodeDescription::from_toml(text, Path::new("etc")).unwrap();
        let output = &node.outputs[0];
        assert_eq!((node.name.as_str(), node.domain_id, node.diagnostics), ("left", Some(7), false));
        assert_eq!(
            (output.topics().imu.as_str(), output.noise.as_deref()),
            ("/left/imu/data_raw", Some(Path::new("etc/imu.yaml")))
        );
        assert_eq!(output.queue, QueueSettings { is_reliable: false, depth: 50 });
        let input = &node.inputs[0];
        assert_eq!((input.samples.interval_ns, input.samples.stamps), (2_500_000, MessageStamps::Arrival));
        assert_eq!(input.samples.resolution, Resolution { accelerometer: 1e-6, gyroscope: 1e-7 });
        let samples = &input.samples;
        assert_eq!(samples.temperature_max_age_s, Some(f64::INFINITY));
        assert!(!samples.has_gravity);
        assert_eq!(input.units, [9.80665 / 1e3, std::f64::consts::PI / 180.0]);
        assert_eq!(samples.temperature_name, "/driver/imu/temperature");
        assert!(input.has_other_clock && output.has_other_clock && !input.samples.has_gyroscopes);
        assert_eq!(
            node.summary(),
            "node of ROS 2 that publishes imu-a and subscribes to imu-a of /driver/imu/data_raw"
        );
    }

    #[test]
    fn all_faults_are_reported_together() {
        let text = r#"
            format = 1
            [ros2]
            name = "a b"
            [[publish]]
            imu = "imu-a"
            rotation = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]
            frames = "x"
            [[subscribe]]
            imu = "imu-b"
            topic = "imu"
        "#;
        let found = faults(text);
        for part in [
            "ros2.name",
            "rotation: is not a rotation",
            "publish.1.frames: unknown key",
            "topic: does not begin",
            "interval_s",
            "temperature_topic: missing",
        ] {
            assert!(found.contains(part), "{part}\n{found}");
        }
    }

    #[test]
    fn a_topic_that_is_published_is_not_subscribed_to() {
        let node = |topic: &str, temperature: &str| {
            let subscribe =
                format!("[[subscribe]]\nimu = \"imu-a\"\ntopic = \"{topic}\"\n{temperature}\ninterval_s = 0.01\n");
            format!("format = 1\n[[publish]]\nimu = \"imu-a\"\n{subscribe}")
        };
        assert_eq!(faults(&node("/driver/imu", "temperature_c = 20")), "");
        let own = "is what this node publishes";
        assert!(faults(&node("/imu_a/imu/data_raw", "temperature_c = 20")).contains(own));
        assert!(faults(&node("/driver/imu", "temperature_topic = \"/imu_a/imu/temperature\"")).contains(own));
        let twice = "format = 1\n[[publish]]\nimu = \"imu-a\"\n[[publish]]\nimu = \"imu-b\"\nnamespace = \"/imu_a\"\n";
        assert!(faults(twice).contains("two publishers"));
        assert!(faults("format = 1\n").contains("[[publish]]"));
        assert!(faults(&node("/driver/imu", "")).contains("those of one temperature"));
        let idle = faults(&node("/driver/imu", "temperature_c = 20\ntemperature_max_age_s = 5"));
        assert!(idle.contains("without temperature_topic"), "{idle}");
        let unit = faults(&node("/driver/imu", "temperature_c = 20\naccelerometer_unit = \"deg/s\""));
        assert!(unit.contains("accelerometer_unit") && unit.contains("mg"), "{unit}");
        let never =
            faults(&node("/driver/imu", "temperature_topic = \"/driver/temperature\"\ntemperature_max_age_s = 0"));
        assert!(never.contains("a number over 0, or inf"), "{never}");
    }

    #[test]
    fn a_temperature_that_nobody_measures_is_known_where_the_imu_is_published() {
        let node = |temperature: &str, published: &str| {
            let text = format!(
                "format = 1\n[[publish]]\nimu = \"{published}\"\n[[subscribe]]\nimu = \"imu-a\"\ntopic = \"/driver/imu\"\n\
                 {temperature}\ninterval_s = 0.01\n"
            );
            NodeDescription::from_toml(&text, Path::new("")).unwrap().outputs[0].assumed_temperature
        };
        assert_eq!(node("temperature_c = 20", "imu-a"), Some(20.0));
        assert_eq!(node("temperature_c = 20", "imu-b"), None);
        assert_eq!(node("temperature_topic = \"/driver/temperature\"", "imu-a"), None);
    }

    #[test]
    fn simulated_time_is_refused_with_what_can_be_done() {
        let node = |value: &str| {
            faults(&format!("format = 1\n[ros2]\nuse_sim_time = {value}\n[[publish]]\nimu = \"imu-a\"\n"))
        };
        assert_eq!(node("false"), "");
        assert!(
            node("true").contains("ros2.use_sim_time: simulated time (use_sim_time) is not followed"),
            "{}",
            node("true")
        );
    }
}
