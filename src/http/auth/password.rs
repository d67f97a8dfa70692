//! Hashes passwords on blocking threads, a few at a time. A check takes as long for an unknown login as for
//! a known one.
//!
//! Requests for a hash wait in one of two queues: that of accounts (callers who have signed in, and browsers that have
//! signed in to the account before), and that of all others. Each queue has threads of its own, so that a flood of
//! sign-ins does not delay people who are known. Each queue is bounded, in all and for each requester: a request that finds no
//! place is refused at once.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};

use axum::http::header;
use tokio::sync::Semaphore;

use crate::domain::scope::Actor;
use crate::domain::secret::{Password, PasswordHash};
use crate::http::error::{HandlerResult, ProblemResponse, Refusal};

/// Hashes of a queue that are computed at once. Each takes 19 MiB and a core: a flood of sign-ins must not occupy all
/// cores.
const HASHES_AT_ONCE: usize = 2;
/// Places of one account.
const MAX_OF_ACCOUNT: usize = 16;
/// Places of all accounts.
const MAX_OF_ACCOUNTS: usize = 64;
/// Places of one network: a class of 40 that signs in behind one address, and a few more. A hash takes 40 to 80 ms, so
/// the last of them waits 2 s.
const MAX_OF_NETWORK: usize = 48;
/// Places of all networks, but for those that [`MAX_OF_NETWORKS`] keeps. The last one waits 2.6 s.
const MAX_OF_STRANGE_NETWORKS: usize = 64;
/// Places of all networks. The difference is kept for networks with a recent sign-in. The last one waits 4.5 s.
const MAX_OF_NETWORKS: usize = MAX_OF_STRANGE_NETWORKS + MAX_OF_NETWORK;
/// Seconds after which a refused client should try again.
const RETRY_AFTER_S: u32 = 3;

/// Compared against when the login is unknown, so that the check takes the same time.
static UNKNOWN_LOGIN_HASH: LazyLock<PasswordHash> = LazyLock::new(PasswordHash::unmatchable);

/// The requester of a hash: what one bound applies to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum HashRequester {
    /// A caller who has signed in, or a browser that has signed in to this account before.
    Account(Actor),
    /// A network with a recent sign-in, of any account: the answers must not show which logins exist.
    KnownNetwork(IpAddr),
    /// Any other network.
    StrangeNetwork(IpAddr),
}

/// The queues for hashes.
#[derive(Debug, Default)]
pub struct PasswordHasher {
    of_accounts: Arc<HashQueue>,
    of_networks: Arc<HashQueue>,
}

#[derive(Debug)]
struct HashQueue {
    threads: Arc<Semaphore>,
    /// Taken places: hashes that wait or are computed.
    taken: Mutex<HashMap<HashRequester, usize>>,
}

/// A place in a queue, freed when dropped.
#[derive(Debug)]
pub struct HashPlace {
    queue: Arc<HashQueue>,
    requester: HashRequester,
}

impl PasswordHasher {
    /// Takes a place for one hash.
    ///
    /// # Errors
    /// All places are taken: 429 if this requester has its most, else 503. Both say when to try again.
    pub fn take_place(&self, requester: HashRequester) -> HandlerResult<HashPlace> {
        let (queue, max_own, max_all) = match requester {
            HashRequester::Account(_) => (&self.of_accounts, MAX_OF_ACCOUNT, MAX_OF_ACCOUNTS),
            HashRequester::KnownNetwork(_) => (&self.of_networks, MAX_OF_NETWORK, MAX_OF_NETWORKS),
            HashRequester::StrangeNetwork(_) => (&self.of_networks, MAX_OF_NETWORK, MAX_OF_STRANGE_NETWORKS),
        };
        let mut taken = queue.lock();
        if taken.get(&requester).is_some_and(|own| *own >= max_own) {
            return Err(too_many_of(requester));
        }
        if taken.values().sum::<usize>() >= max_all {
            return Err(too_many_in_all());
        }
        *taken.entry(requester).or_default() += 1;
        Ok(HashPlace { queue: queue.clone(), requester })
    }
}

impl Default for HashQueue {
    fn default() -> Self {
        Self { threads: Arc::new(Semaphore::new(HASHES_AT_ONCE)), taken: Mutex::default() }
    }
}

impl HashQueue {
    fn lock(&self) -> MutexGuard<'_, HashMap<HashRequester, usize>> {
        self.taken.lock().unwrap_or_else(PoisonError::into_inner) // counts are whole at every moment
    }
}

impl HashPlace {
    /// The hash to store for a password.
    pub async fn hash(self, password: Password) -> HandlerResult<PasswordHash> {
        self.run_blocking(move || password.hash()).await
    }

    /// A hash for an account without a password: no password matches it.
    pub async fn unmatchable(self) -> HandlerResult<PasswordHash> {
        self.run_blocking(PasswordHash::unmatchable).await
    }

    /// Whether `tried` matches `stored`. Without a stored hash the answer is no, after the same time.
    pub async fn matches(self, tried: Password, stored: Option<PasswordHash>) -> HandlerResult<bool> {
        self.run_blocking(move || match stored {
            Some(stored) => stored.matches(&tried),
            None => {
                UNKNOWN_LOGIN_HASH.matches(&tried);
                false
            }
        })
        .await
    }

    /// Runs work on one of the queue's threads. The thread and the place are occupied until the work ends, even if the
    /// client is gone.
    async fn run_blocking<T: Send + 'static>(self, work: impl FnOnce() -> T + Send + 'static) -> HandlerResult<T> {
        let thread = self.queue.threads.clone().acquire_owned().await;
        let thread = thread.map_err(|e| ProblemResponse::internal("waiting for a thread for a hash", e))?;
        let done = tokio::task::spawn_blocking(move || {
            let done = work();
            drop((thread, self));
            done
        });
        done.await.map_err(|e| ProblemResponse::internal("hashing a password", e))
    }
}

impl Drop for HashPlace {
    fn drop(&mut self) {
        let mut taken = self.queue.lock();
        if let Some(own) = taken.get_mut(&self.requester) {
            *own -= 1;
            if *own == 0 {
                taken.remove(&self.requester);
            }
        }
    }
}

fn too_many_of(requester: HashRequester) -> ProblemResponse {
    let whose = match requester {
        HashRequester::Account(_) => "Too many passwords of your account",
        HashRequester::KnownNetwork(_) | HashRequester::StrangeNetwork(_) => "Too many passwords from your network",
    };
    Refusal::TooMany
        .with(format!("{whose} are being checked. Try again in {RETRY_AFTER_S} s."))
        .header(header::RETRY_AFTER, RETRY_AFTER_S)
}

fn too_many_in_all() -> ProblemResponse {
    Refusal::Busy
        .with(format!("Too many people are signing in. Try again in {RETRY_AFTER_S} s."))
        .header(header::RETRY_AFTER, RETRY_AFTER_S)
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::*;
    use crate::ids::PersonId;

    fn network(n: u32) -> IpAddr {
        IpAddr::from(n.to_be_bytes())
    }

    /// Takes places until one is refused.
    fn fill(hasher: &PasswordHasher, requester: HashRequester) -> (Vec<HashPlace>, Refusal) {
        let mut taken = Vec::new();
        loop {
            match hasher.take_place(requester) {
                Ok(place) => taken.push(place),
                Err(refused) => return (taken, refused.refusal),
            }
        }
    }

    #[test]
    fn strangers_leave_places_for_each_other_for_known_networks_and_for_accounts() {
        let hasher = PasswordHasher::default();
        let (one, refused) = fill(&hasher, HashRequester::StrangeNetwork(network(1)));
        assert_eq!((one.len(), refused), (48, Refusal::TooMany));
        let (others, refused) = fill(&hasher, HashRequester::StrangeNetwork(network(2)));
        assert_eq!((others.len(), refused), (16, Refusal::Busy));
        let (class, refused) = fill(&hasher, HashRequester::KnownNetwork(network(3)));
        assert_eq!((class.len(), refused), (48, Refusal::TooMany));
        assert_eq!(fill(&hasher, HashRequester::KnownNetwork(network(4))).1, Refusal::Busy);
        let (of_ada, refused) = fill(&hasher, HashRequester::Account(Actor::Person(PersonId::at(1))));
        assert_eq!((of_ada.len(), refused), (16, Refusal::TooMany));
        drop((one, others));
        assert_eq!(fill(&hasher, HashRequester::StrangeNetwork(network(5))).0.len(), 16);
        drop(class);
        assert_eq!(fill(&hasher, HashRequester::StrangeNetwork(network(5))).0.len(), 48);
        drop(of_ada);
        assert!([&hasher.of_accounts, &hasher.of_networks].iter().all(|queue| queue.lock().is_empty()));
    }

    #[tokio::test]
    async fn a_client_that_disconnects_frees_no_thread_before_its_hash_has_ended() {
        let hasher = PasswordHasher::default();
        let ((begun, has_begun), (end, ended)) = (mpsc::channel(), mpsc::channel::<()>());
        let place = hasher.take_place(HashRequester::StrangeNetwork(network(1))).unwrap();
        let request = tokio::spawn(place.run_blocking(move || {
            begun.send(()).unwrap();
            ended.recv().unwrap();
        }));
        tokio::task::spawn_blocking(move || has_begun.recv().unwrap()).await.unwrap();
        request.abort();
        assert!(request.await.unwrap_err().is_cancelled());
        assert_eq!(hasher.of_networks.threads.available_permits(), HASHES_AT_ONCE - 1);
        end.send(()).unwrap();
        let all = u32::try_from(HASHES_AT_ONCE).unwrap();
        drop(hasher.of_networks.threads.acquire_many(all).await.unwrap());
    }
}
