//! How a run tells where it stands and is told to stop, while its own thread waits for the workers: a few words that both sides look at. The
//! observer stays on the thread that asked for the solution.

use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

/// Where a run stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Light from the emitters.
    Direct,
    /// Light between surfaces.
    Interreflection,
}

/// Who watches a run and may stop it.
pub trait Observer {
    /// A pass begins: 0 is the pilot.
    fn pass(&mut self, _number: usize) {}
    /// Share of a stage that is done, in [0, 1].
    fn progress(&mut self, _stage: Stage, _share: f64) {}
    /// Whether to stop after the elements at hand; asked some twenty times a second.
    fn interrupted(&mut self) -> bool {
        false
    }
}

/// An observer that does nothing.
pub struct Silent;

impl Observer for Silent {}

/// Between two looks at the run.
const TICK: Duration = Duration::from_millis(50);

/// What is told at once, because times are booked by it.
enum Event {
    Pass(usize),
    Stage(Stage),
    End,
}

/// The run's side. Relaxed throughout: the words carry no data with them, and a late look only costs a tick.
pub(super) struct Watch {
    stop: AtomicBool,
    /// Share of the stage done before the batch at hand and after it, as bits.
    from: AtomicU64,
    to: AtomicU64,
    parts: AtomicU64,
    done: AtomicU64,
    events: Sender<Event>,
}

impl Watch {
    fn new(events: Sender<Event>) -> Self {
        let zero = || AtomicU64::new(0);
        let (from, to, parts, done) = (zero(), zero(), zero(), zero());
        Self { stop: AtomicBool::new(false), from, to, parts, done, events }
    }

    /// Whether to stop; polled before every element of a pair.
    pub fn stopped(&self) -> bool {
        self.stop.load(Relaxed)
    }

    /// A pass begins.
    pub fn pass(&self, number: usize) {
        // The other end goes away only after the run.
        let _ = self.events.send(Event::Pass(number));
    }

    /// A stage begins.
    pub fn stage(&self, stage: Stage) {
        self.batch(0.0, 0.0, 0);
        let _ = self.events.send(Event::Stage(stage));
    }

    /// A batch of so many parts, its receivers or its walks, begins; it takes the stage from one share to another.
    pub fn batch(&self, from: f64, to: f64, parts: usize) {
        self.from.store(from.to_bits(), Relaxed);
        self.to.store(to.to_bits(), Relaxed);
        self.parts.store(parts as u64, Relaxed);
        self.done.store(0, Relaxed);
    }

    /// The batch at hand has so many parts.
    pub fn parts(&self, number: usize) {
        self.parts.store(number as u64, Relaxed);
    }

    /// A part is done.
    pub fn part_done(&self) {
        self.done.fetch_add(1, Relaxed);
    }

    fn share(&self) -> f64 {
        let number = |bits: &AtomicU64| f64::from_bits(bits.load(Relaxed));
        let (from, to) = (number(&self.from), number(&self.to));
        let part = self.done.load(Relaxed) as f64 / self.parts.load(Relaxed).max(1) as f64;
        from + (to - from) * part.min(1.0)
    }
}

/// Stack of the thread that conducts a run, and that does all of it where there is no team.
const STACK_BYTES: usize = 64 << 20;

/// Runs `run` on a thread of its own, and the observer on this one.
pub(super) fn observed<R: Send>(observer: &mut dyn Observer, run: impl FnOnce(&Watch) -> R + Send) -> R {
    let (sender, events) = channel();
    let watch = Watch::new(sender);
    std::thread::scope(|scope| {
        let conduct = || {
            let result = run(&watch);
            let _ = watch.events.send(Event::End);
            result
        };
        let conductor = std::thread::Builder::new().name("conductor".to_owned()).stack_size(STACK_BYTES);
        let conductor = conductor.spawn_scoped(scope, conduct);
        let conductor = conductor.unwrap_or_else(|error| ccnuma::exhausted::without_thread(&error));
        follow(&watch, &events, observer, || conductor.is_finished());
        conductor.join().unwrap_or_else(|payload| std::panic::resume_unwind(payload))
    })
}

fn follow(watch: &Watch, events: &Receiver<Event>, observer: &mut dyn Observer, finished: impl Fn() -> bool) {
    let mut stage = Stage::Direct;
    while !finished() {
        match events.recv_timeout(TICK) {
            Ok(Event::Pass(number)) => observer.pass(number),
            Ok(Event::Stage(begun)) => {
                stage = begun;
                observer.progress(stage, 0.0);
            }
            Err(RecvTimeoutError::Timeout) => observer.progress(stage, watch.share()),
            Ok(Event::End) | Err(RecvTimeoutError::Disconnected) => return,
        }
        if observer.interrupted() {
            watch.stop.store(true, Relaxed);
        }
    }
}
