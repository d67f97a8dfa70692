//! Limits of the child processes.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::protocol::ChildWork;
use crate::sandbox::{Budget, LandlockPolicy};

/// Limits of the children.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AnalysisSettings {
    /// Decoder threads of each child, beside the one that tracks. More than two seldom help; workers times threads
    /// should not exceed the cores. Usually 2.
    pub decoder_threads: usize,
    /// Memory that a child may take beyond the program's own, MiB. Less refuses large pictures and long recordings,
    /// more lets a hostile file take more. 448 decodes 4096×2304 and tracks an hour of two tools.
    pub memory_mib: u64,
    /// Longest time that a child may work, s. Then it is killed and the job is tried again, up to
    /// `store.max_attempts` times in all. Usually 14400.
    pub longest_s: u64,
    /// Longest time that a child may go without reporting progress, s. Usually 60.
    pub silence_s: u64,
    /// Memory that a child which scores a path may take beyond the program's own, MiB. Less refuses long paths, more
    /// lets several children fill a small machine. 480,000 rows of another tracker take 620 MiB. Usually 1024.
    pub scoring_memory_mib: u64,
    /// Longest time that scoring one path may take, s. Scoring reports no progress. 480,000 rows take 40 s on one core.
    /// Usually 1800.
    pub scoring_s: u64,
    /// Photos, frames, edits and tables checked at the same time outside the queue, for users who wait. Each takes one
    /// core while it runs. Usually 2.
    pub glances: usize,
    /// Longest time that such a check may take, and longest time that it may wait for a slot, s. Usually 20.
    pub glance_s: u64,
    /// Refuse to start where the kernel does not enforce Landlock (Linux 5.13 or newer, and enabled). Otherwise the
    /// children are confined by the system call filter alone.
    pub require_landlock: bool,
}

impl Default for AnalysisSettings {
    fn default() -> Self {
        Self {
            decoder_threads: 2,
            memory_mib: 448,
            longest_s: 4 * 3600,
            silence_s: 60,
            scoring_memory_mib: 2048,
            scoring_s: 1800,
            glances: 2,
            glance_s: 20,
            require_landlock: true,
        }
    }
}

impl AnalysisSettings {
    /// The budget of a child that does this work for a waiting user.
    pub fn quick_budget(&self, work: &ChildWork) -> Budget {
        let longest = Duration::from_secs(self.glance_s);
        Budget { cpu: longest, slice: Budget::SHORT_SLICE, wall: longest, silence: longest, ..self.budget_of(work) }
    }

    /// The budget of a job's child that does this work.
    pub fn budget_of(&self, work: &ChildWork) -> Budget {
        match work {
            ChildWork::Score(_) | ChildWork::CheckEdit(_) | ChildWork::CheckTable(_) => {
                let longest = Duration::from_secs(self.scoring_s);
                let memory_bytes = self.scoring_memory_mib << 20;
                Budget { memory_bytes, cpu: longest, wall: longest, silence: longest, ..self.budget() }
            }
            _ => self.budget(),
        }
    }

    /// The budget of a child that decodes.
    pub fn budget(&self) -> Budget {
        let landlock = if self.require_landlock { LandlockPolicy::Required } else { LandlockPolicy::IfAvailable };
        Budget {
            memory_bytes: self.memory_mib << 20,
            // The limit is on CPU time: all threads together may compute for as long as the child may run.
            cpu: Duration::from_secs(self.longest_s.saturating_mul(self.decoder_threads as u64 + 1)),
            wall: Duration::from_secs(self.longest_s),
            silence: Duration::from_secs(self.silence_s),
            landlock,
            ..Budget::default()
        }
    }
}
