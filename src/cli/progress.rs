//! The observer of a run: progress with an estimate of the time left, on a terminal only; the time of each stage; Ctrl-C, and the
//! end of memory.

use std::time::Instant;

use indicatif::{ProgressBar, ProgressStyle};

use crate::schedule::{Observer, Stage};

use super::interrupt;
use super::memory::Memory;

const STEPS: u64 = 1000;

/// Watches a run.
pub(super) struct Watch {
    bar: ProgressBar,
    pass: usize,
    stage: Option<Stage>,
    since: Instant,
    memory: Memory,
    /// Why the run was stopped for want of memory.
    pub out_of_memory: Option<String>,
    /// Seconds in direct illumination, all passes.
    pub direct_s: f64,
    /// Seconds in interreflection, all passes.
    pub interreflection_s: f64,
}

impl Watch {
    /// Starts watching; a quiet one shows nothing.
    pub fn new(quiet: bool) -> Watch {
        // Standard error, drawn only if that is a terminal.
        let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(STEPS) };
        let template = "{prefix:<26} {wide_bar} {percent:>3} %  left {eta:<4}";
        bar.set_style(ProgressStyle::with_template(template).expect("the template is a valid constant"));
        Watch {
            bar,
            pass: 0,
            stage: None,
            since: Instant::now(),
            memory: Memory::of_this_process(),
            out_of_memory: None,
            direct_s: 0.0,
            interreflection_s: 0.0,
        }
    }

    /// The run is over.
    pub fn finish(&mut self) {
        self.book();
        self.bar.finish_and_clear();
    }

    /// Books the time since the last booking to the stage at hand.
    fn book(&mut self) {
        let now = Instant::now();
        let seconds = (now - self.since).as_secs_f64();
        self.since = now;
        match self.stage {
            Some(Stage::Interreflection) => self.interreflection_s += seconds,
            Some(Stage::Direct) | None => self.direct_s += seconds,
        }
    }

    fn enter(&mut self, stage: Stage) {
        self.book();
        self.stage = Some(stage);
        let pass = match self.pass {
            0 => "pilot".to_owned(),
            n => format!("pass {n}"),
        };
        let stage = match stage {
            Stage::Direct => "direct light",
            Stage::Interreflection => "interreflection",
        };
        self.bar.reset();
        self.bar.set_prefix(format!("{pass}: {stage}"));
    }
}

impl Observer for Watch {
    fn pass(&mut self, number: usize) {
        self.pass = number;
        self.enter(Stage::Direct);
    }

    fn progress(&mut self, stage: Stage, share: f64) {
        if self.stage != Some(stage) {
            self.enter(stage);
        }
        self.bar.set_position((share.clamp(0.0, 1.0) * STEPS as f64) as u64);
    }

    fn interrupted(&mut self) -> bool {
        if self.out_of_memory.is_none() {
            self.out_of_memory = self.memory.running_out();
        }
        interrupt::requested() || self.out_of_memory.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_goes_to_the_stage_at_hand_over_all_passes() {
        let mut watch = Watch::new(true);
        let wait = || std::thread::sleep(std::time::Duration::from_millis(5));
        for pass in 0..2 {
            watch.pass(pass);
            wait();
            watch.progress(Stage::Direct, f64::NAN);
            watch.progress(Stage::Interreflection, 0.0);
            wait();
        }
        watch.finish();
        assert!(watch.direct_s >= 0.01 && watch.interreflection_s >= 0.01, "{}", watch.direct_s);
    }
}
