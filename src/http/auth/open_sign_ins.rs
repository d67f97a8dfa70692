//! Ends event streams, live views and feeds with the sign-in or token that opened them.
//!
//! One task asks the database about all of them: at once when the store may have ended a sign-in or token, and every
//! few seconds for those that expire and those that another process ends. So hundreds of browsers cost one query.
//! Rejected: a query of each stream, since those of all browsers fall into the same moments, and other requests wait for
//! them.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::watch;

use super::presented::PresentedCredential;
use crate::http::state::App;
use crate::store::StoreResult;

/// How often to check the sign-ins and tokens of all streams.
const CHECK_INTERVAL: Duration = Duration::from_secs(5);

/// The sign-ins and tokens with open streams.
#[derive(Debug, Default)]
pub struct OpenSignIns(Mutex<HashMap<PresentedCredential, watch::Sender<()>>>);

impl OpenSignIns {
    /// A receiver whose sender is dropped once this credential no longer signs in.
    pub fn watch(&self, credential: PresentedCredential) -> watch::Receiver<()> {
        self.senders().entry(credential).or_insert_with(|| watch::Sender::new(())).subscribe()
    }

    /// The credentials of open streams; forgets the others.
    fn in_use(&self) -> Vec<PresentedCredential> {
        let mut senders = self.senders();
        senders.retain(|_, sender| sender.receiver_count() > 0);
        senders.keys().copied().collect()
    }

    fn end(&self, credential: PresentedCredential) {
        self.senders().remove(&credential);
    }

    fn senders(&self) -> MutexGuard<'_, HashMap<PresentedCredential, watch::Sender<()>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner) // no panic leaves the table half changed
    }
}

impl App {
    /// Ends the streams of sign-ins and tokens that have ended, until the service stops.
    pub async fn end_streams_with_sign_ins(&self) {
        let (mut may_have_ended, stop) = (self.store.ended_sign_ins(), self.shutdown.begun());
        tokio::pin!(stop);
        loop {
            tokio::select! {
                () = &mut stop => return,
                _ = may_have_ended.changed() => {} // the store has the sender, so this is no error
                () = tokio::time::sleep(CHECK_INTERVAL) => {}
            }
            match self.ended_of(self.open_sign_ins.in_use()).await {
                Ok(ended) => ended.into_iter().for_each(|credential| self.open_sign_ins.end(credential)),
                Err(error) => tracing::warn!(%error, "sign-ins of open streams not checked; checking again soon"),
            }
        }
    }

    /// Those of these credentials that no longer sign in: cookies first, so that no token delays them.
    async fn ended_of(&self, open: Vec<PresentedCredential>) -> StoreResult<Vec<PresentedCredential>> {
        let cookies = open.iter().filter_map(|credential| match credential {
            PresentedCredential::Cookie(secret) => Some(*secret),
            PresentedCredential::Token(_) | PresentedCredential::Nothing => None,
        });
        let valid = self.store.cookies().valid_of(cookies.collect(), self.sign_in_lifetime()).await?;
        let mut ended = Vec::new();
        for credential in open {
            let is_valid = match credential {
                PresentedCredential::Cookie(secret) => valid.contains(&secret),
                // One by one, which records that they are used: few programs watch. An error ends none.
                PresentedCredential::Token(secret) => {
                    self.store.tokens().scope_of(secret).await.map_or(true, |scope| scope.is_some())
                }
                PresentedCredential::Nothing => false,
            };
            if !is_valid {
                ended.push(credential);
            }
        }
        Ok(ended)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::secret::SecretHash;

    #[tokio::test]
    async fn all_streams_of_a_sign_in_are_one_and_end_together() {
        let open = OpenSignIns::default();
        let cookie = |n: u8| PresentedCredential::Cookie(SecretHash([n; 32]));
        let mut streams: Vec<_> = (0..200).map(|n| open.watch(cookie(n % 2))).collect();
        assert_eq!(open.in_use().len(), 2);
        open.end(cookie(0));
        for (n, stream) in (0..).zip(&mut streams) {
            assert_eq!(stream.has_changed().is_err(), n % 2 == 0, "stream {n}");
        }
        assert_eq!(open.in_use(), [cookie(1)]);
        drop(streams);
        assert_eq!(open.in_use(), [], "no stream is open");
    }
}
