//! Faults, on the real program as a process of its own: killed, cut from its power, watched at its system calls, besieged.
//!
//! | file | claims |
//! |---|---|
//! | `agent.rs` | a box's agent brings its recording home, whoever dies on the way |
//! | `feeds.rs` | no acknowledged frame is lost or doubled, whatever happens between a box and the service |
//! | `kills.rs` | nothing acknowledged is lost when service or children are killed |
//! | `order.rs` | no acknowledgement leaves before its bytes and names were synced |
//! | `power.rs` | nothing acknowledged is lost when the power is cut |
//! | `pushes.rs` | what came of a pushed stream is a session, whoever dies |
//! | `rescoring.rs` | what is scored again gives the same bytes, whoever dies |
//! | `slow.rs` | a thousand slow clients hurt nobody else |
//! | `unprivileged.rs` | the service needs no privilege, and says what it lacks |
//!
//! A kill cannot show a missing sync, since the system's cache outlives the process: that is what `order` and `power` are for.

mod agent;
mod centre;
mod feeds;
mod kills;
mod order;
mod power;
mod pushes;
mod rescoring;
mod slow;
mod unprivileged;

use centre::{Centre, padded, padded_bytes};

/// Marsaglia's xorshift64: the same moments in every run.
pub struct Dice(u64);

impl Dice {
    pub fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    pub fn below(&mut self, limit: usize) -> usize {
        (self.next() % limit.max(1) as u64) as usize
    }
}
