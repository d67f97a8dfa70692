//! Faults, on the real program as a separate process: killed, cut from power, traced at its system calls, overloaded.
//!
//! | file | claims |
//! |---|---|
//! | `agent.rs` | a box's agent delivers its recording, even if the agent or the service is killed on the way |
//! | `feeds.rs` | no acknowledged frame is lost or doubled by faults between a box and the service |
//! | `full_disk.rs` | a full disk of a box or of the service crashes nothing and loses nothing acknowledged |
//! | `kills.rs` | nothing acknowledged is lost when service or children are killed |
//! | `morning.rs` | a busy morning leaves reading quick and the service small |
//! | `order.rs` | no acknowledgement leaves before its bytes and names were synced |
//! | `power.rs` | nothing acknowledged is lost when the power is cut |
//! | `pushes.rs` | the part of a pushed stream that arrived becomes a session, even if service or child are killed |
//! | `rescoring.rs` | scoring again gives the same bytes, even if the service is killed |
//! | `sign_ins.rs` | wrong sign-ins leave no memory behind |
//! | `slow.rs` | a thousand slow clients do not affect other clients |
//! | `unprivileged.rs` | the service needs no privilege, and says what the system lacks |
//!
//! A kill cannot show a missing sync, since the system's cache outlives the process: `order` and `power` test that.

mod agent;
mod centre;
mod feeds;
mod full_disk;
mod kills;
mod morning;
mod order;
mod outage;
mod power;
mod pushes;
mod rescoring;
mod sign_ins;
mod slow;
mod unprivileged;

use centre::{Centre, padded, padded_bytes};

/// Marsaglia's xorshift64: the same random numbers in every run.
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
