//! The agent that stands by at a box: the state that it reports, and the messages between it and the server
//! (`docs/agent.md`).
//!
//! | file | holds |
//! |---|---|
//! | [`messages`] | the JSON messages of the connection |
//! | [`state`] | camera, light, spool, clock and recording of a box |
//! | [`pin`] | the PIN that a trainee checks in with at a box |
//! | [`self_test_need`] | whether a box needs a self-test before the next exam |

pub mod messages;
pub mod pin;
pub mod self_test_need;
pub mod state;

use std::time::Duration;

/// The protocol version of this program.
pub const PROTOCOL: u32 = 1;
/// How often an agent reports its state.
pub const STATE_INTERVAL: Duration = Duration::from_secs(2);
/// Silence after which a box counts as silent. Three states may be late; a page shows the truth within ten seconds.
pub const SILENT_AFTER: Duration = Duration::from_secs(7);
/// How long a trainee stays checked in without a recording: long enough to rest between two attempts, short enough that
/// the next person at the box is not recorded under the name of the previous one.
pub const CHECK_IN_IDLE: Duration = Duration::from_secs(10 * 60);
