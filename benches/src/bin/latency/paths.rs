//! The paths from a sample to its answer. All are used in the same way: fill a sample in, send it, wait, copy the
//! answer out.

use core::fmt::Debug;
use core::mem::MaybeUninit;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{BackpressureStrategy, IceoryxSend, Node, NodeBuilder, SignalHandlingMode, ZeroCopySend, ipc};
use iceoryx2::sample::Sample;
use iceoryx2::sample_mut::SampleMut;
use iceoryx2::sample_mut_uninit::SampleMutUninit;
use iceoryx2::service::builder::publish_subscribe::Builder;
use isotherm_benches::{BenchResult, Spin, TABLE, TIMEOUT};
use isotherm_client::{Acquisition, CompensatedIncrement, Domain, RawSample};
use isotherm_shared::compensate::answer;
use isotherm_shared::table::CoefficientTable;
use std::hint::{black_box, spin_loop};
use std::rc::Rc;
use std::time::{Duration, Instant};

/// How long before a sample is due its path gets ready for it, and how much longer for each of many streams.
const PREPARE: Duration = Duration::from_micros(40);
const PREPARE_EACH: Duration = Duration::from_micros(3);

/// One way to send a sample and get its answer.
pub(crate) trait Path {
    /// Sends the sample and waits for the answer.
    fn round_trip(&mut self, sample: &RawSample) -> BenchResult<CompensatedIncrement>;

    /// Gets ready for the next sample, shortly before it is due.
    fn prepare(&mut self) -> BenchResult<()> {
        Ok(())
    }

    /// How long before a sample is due [`prepare`](Self::prepare) is called.
    fn lead(&self) -> Duration {
        PREPARE
    }
}

/// A path on which a sample can be sent before the one before it is answered.
pub(crate) trait Stream: Path {
    /// Sends a sample.
    fn send(&mut self, sample: &RawSample) -> BenchResult<()>;

    /// An answer, if one is there.
    fn receive(&mut self) -> BenchResult<Option<CompensatedIncrement>>;
}

/// Sends a sample and spins until its answer is there.
#[inline]
fn exchange(stream: &mut impl Stream, sample: &RawSample) -> BenchResult<CompensatedIncrement> {
    stream.send(sample)?;
    let mut spin = Spin::default();
    loop {
        if let Some(increment) = stream.receive()? {
            return Ok(increment);
        }
        spin.turn()?;
    }
}

/// The client library, waiting for the answer by spinning.
pub(crate) struct Isotherm(pub Acquisition);

impl Path for Isotherm {
    fn prepare(&mut self) -> BenchResult<()> {
        self.0.prepare();
        Ok(())
    }

    fn round_trip(&mut self, sample: &RawSample) -> BenchResult<CompensatedIncrement> {
        exchange(self, sample)
    }
}

impl Stream for Isotherm {
    #[inline]
    fn send(&mut self, sample: &RawSample) -> BenchResult<()> {
        let mut loan = self.0.loan()?;
        let (session, sequence) = (loan.session, loan.sequence);
        *loan = RawSample { session, sequence, ..*sample };
        Ok(self.0.send(loan)?)
    }

    #[inline]
    fn receive(&mut self) -> BenchResult<Option<CompensatedIncrement>> {
        Ok(self.0.receive()?)
    }
}

/// A bare pair of iceoryx2's publish-subscribe streams, used in the fastest way: the next sample is loaned ahead, and
/// the queues are short.
pub(crate) struct Bare {
    publisher: Publisher<ipc::Service, RawSample, ()>,
    spare: Option<SampleMut<ipc::Service, RawSample, ()>>,
    subscriber: Subscriber<ipc::Service, CompensatedIncrement, ()>,
    /// Whether loaning the next sample and returning the answer are left to [`get_ready`](Self::get_ready).
    leaves: bool,
    /// The answer that has not been returned.
    read: Option<Sample<ipc::Service, CompensatedIncrement, ()>>,
    _node: Rc<Node<ipc::Service>>,
}

impl Bare {
    /// Connects to the [`echo`] of this domain, which may not be ready yet.
    pub(crate) fn connect(domain: &Domain, depth: usize) -> BenchResult<Self> {
        Self::connect_all(domain, depth, 1)?.pop().ok_or_else(|| "no pair".into())
    }

    /// Connects `count` pairs to the [`echo`] of this domain, which must have as many.
    pub(crate) fn connect_all(domain: &Domain, depth: usize, count: usize) -> BenchResult<Vec<Self>> {
        let node = Rc::new(node(domain)?);
        let pairs = (0..count).map(|index| Self::connect_pair(&node, depth, index)).collect::<BenchResult<Vec<_>>>()?;
        std::thread::sleep(Duration::from_millis(20));
        for pair in &pairs {
            while pair.subscriber.receive()?.is_some() {}
        }
        Ok(pairs)
    }

    /// Connects a pair. It may still get answers to the samples that it has sent meanwhile.
    fn connect_pair(node: &Rc<Node<ipc::Service>>, depth: usize, index: usize) -> BenchResult<Self> {
        let raw = stream::<RawSample>(node, &raw_name(index), depth)?.open_or_create()?;
        let publisher =
            raw.publisher_builder().max_loaned_samples(2).backpressure_strategy(BackpressureStrategy::DiscardData);
        let publisher = publisher.create()?;
        let answers = stream::<CompensatedIncrement>(node, &answer_name(index), depth)?.open_or_create()?;
        let subscriber = answers.subscriber_builder().create()?;
        let deadline = Instant::now() + TIMEOUT;
        while subscriber.receive()?.is_none() {
            // Until the echo has subscribed, nobody receives these samples.
            publisher.send_copy(RawSample::default())?;
            std::thread::sleep(Duration::from_millis(1));
            if Instant::now() > deadline {
                return Err("the echo does not answer".into());
            }
        }
        let spare = Some(publisher.loan()?);
        Ok(Self { spare, publisher, subscriber, leaves: false, read: None, _node: Rc::clone(node) })
    }

    /// Returns the last answer and loans the next sample, if that was left.
    fn get_ready(&mut self) -> BenchResult<()> {
        self.read = None;
        if self.spare.is_none() {
            self.spare = Some(self.publisher.loan()?);
        }
        Ok(())
    }
}

impl Path for Bare {
    fn round_trip(&mut self, sample: &RawSample) -> BenchResult<CompensatedIncrement> {
        exchange(self, sample)
    }
}

impl Stream for Bare {
    /// Sends a sample, then loans the next one.
    #[inline]
    fn send(&mut self, sample: &RawSample) -> BenchResult<()> {
        let mut loan = match self.spare.take() {
            Some(loan) => loan,
            None => self.publisher.loan()?,
        };
        *loan = *sample;
        loan.send()?;
        if !self.leaves {
            self.get_ready()?;
        }
        Ok(())
    }

    #[inline]
    fn receive(&mut self) -> BenchResult<Option<CompensatedIncrement>> {
        let Some(sample) = self.subscriber.receive()? else { return Ok(None) };
        let answer = *sample;
        self.read = self.leaves.then_some(sample);
        Ok(Some(answer))
    }
}

/// A bare pair that gets ready with a round trip through a second pair, to the same [`echo`]: the code of both
/// processes is in their caches when the sample is sent, its memory is not. It leaves to that moment what an answer
/// does not need.
pub(crate) struct Rehearsed {
    pair: Bare,
    second: Bare,
}

impl Rehearsed {
    /// Connects to the [`echo`] of this domain, which must have two pairs.
    pub(crate) fn connect(domain: &Domain, depth: usize) -> BenchResult<Self> {
        let mut pairs = Bare::connect_all(domain, depth, 2)?;
        let (second, mut pair) = pairs.pop().zip(pairs.pop()).ok_or("no second pair")?;
        pair.leaves = true;
        Ok(Self { pair, second })
    }
}

impl Path for Rehearsed {
    fn round_trip(&mut self, sample: &RawSample) -> BenchResult<CompensatedIncrement> {
        self.pair.round_trip(sample)
    }

    fn prepare(&mut self) -> BenchResult<()> {
        self.pair.get_ready()?;
        black_box(self.second.round_trip(&isotherm_benches::sample())?);
        Ok(())
    }
}

/// The echo's side of a [`Bare`] pair.
struct EchoPair {
    subscriber: Subscriber<ipc::Service, RawSample, ()>,
    answers: Publisher<ipc::Service, CompensatedIncrement, ()>,
    spare: Option<SampleMutUninit<ipc::Service, MaybeUninit<CompensatedIncrement>, ()>>,
}

impl EchoPair {
    fn create(node: &Node<ipc::Service>, depth: usize, index: usize) -> BenchResult<Self> {
        let raw = stream::<RawSample>(node, &raw_name(index), depth)?.open_or_create()?;
        let subscriber = raw.subscriber_builder().create()?;
        let answers = stream::<CompensatedIncrement>(node, &answer_name(index), depth)?.open_or_create()?;
        let answers = answers.publisher_builder().max_loaned_samples(2);
        let answers = answers.backpressure_strategy(BackpressureStrategy::DiscardData).create()?;
        Ok(Self { subscriber, spare: Some(answers.loan_uninit()?), answers })
    }

    /// Answers a sample if one is there, then loans the next answer.
    #[inline]
    fn turn(&mut self) -> BenchResult<()> {
        let Some(sample) = self.subscriber.receive()? else { return Ok(()) };
        let raw = black_box(*sample);
        let increment = CompensatedIncrement { session: raw.session, sequence: raw.sequence, ..Default::default() };
        let spare = match self.spare.take() {
            Some(spare) => spare,
            None => self.answers.loan_uninit()?,
        };
        spare.write_payload(increment).send()?;
        drop(sample);
        self.spare = Some(self.answers.loan_uninit()?);
        Ok(())
    }
}

/// The other end of `count` [`Bare`] pairs: copies each sample out and answers with its session and sequence. It
/// compensates nothing.
pub(crate) fn echo(domain: &str, root: &str, depth: usize, count: usize) -> BenchResult<()> {
    let node = node(&Domain::new(domain, root)?)?;
    let pairs = (0..count).map(|index| EchoPair::create(&node, depth, index));
    let mut pairs = pairs.collect::<BenchResult<Vec<_>>>()?;
    loop {
        for pair in &mut pairs {
            pair.turn()?;
        }
        spin_loop();
    }
}

fn raw_name(index: usize) -> String {
    format!("bench/raw/{index}")
}

fn answer_name(index: usize) -> String {
    format!("bench/increment/{index}")
}

/// A node with the settings of Isotherm's nodes.
fn node(domain: &Domain) -> BenchResult<Node<ipc::Service>> {
    let node = NodeBuilder::new()
        .config(&isotherm_client::transport::stream::configuration(domain)?)
        .signal_handling_mode(SignalHandlingMode::Disabled);
    Ok(node.create()?)
}

fn stream<T: IceoryxSend + ZeroCopySend + Debug>(
    node: &Node<ipc::Service>,
    name: &str,
    depth: usize,
) -> BenchResult<Builder<T, (), ipc::Service>> {
    let builder = node.service_builder(&name.try_into()?).publish_subscribe::<T>();
    let builder = builder.max_publishers(1).max_subscribers(1).subscriber_max_buffer_size(depth);
    Ok(builder.history_size(0).enable_safe_overflow(true))
}

/// Many streams that send together: a round trip lasts until the last of their samples is answered.
pub(crate) struct Together<S>(pub Vec<S>);

impl<S: Stream> Path for Together<S> {
    fn round_trip(&mut self, sample: &RawSample) -> BenchResult<CompensatedIncrement> {
        self.0.iter_mut().try_for_each(|stream| stream.send(sample))?;
        let (mut last, mut open, mut spin) = (None, self.0.len(), Spin::default());
        while open > 0 {
            for stream in &mut self.0 {
                if let Some(increment) = stream.receive()? {
                    last = Some(increment);
                    open -= 1;
                    spin = Spin::default();
                }
            }
            spin.turn()?;
        }
        last.ok_or_else(|| "no streams".into())
    }

    fn prepare(&mut self) -> BenchResult<()> {
        self.0.iter_mut().try_for_each(Path::prepare)
    }

    fn lead(&self) -> Duration {
        PREPARE + PREPARE_EACH * self.0.len() as u32
    }
}

/// The kernel called as a function.
pub(crate) struct InProcess(CoefficientTable);

impl InProcess {
    /// A kernel with the table that the service has.
    pub(crate) fn new() -> BenchResult<Self> {
        CoefficientTable::from_toml(TABLE, None).map(Self).map_err(|faults| faults.to_string().into())
    }
}

impl Path for InProcess {
    fn round_trip(&mut self, sample: &RawSample) -> BenchResult<CompensatedIncrement> {
        Ok(answer(Some(&self.0), black_box(sample)))
    }
}
