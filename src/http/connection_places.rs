//! The places of a listener: how many connections may be open, and which one is closed for a new one when all places
//! are taken.
//!
//! A connection is *replaceable* while it serves no request of a caller who has signed in: during the TLS handshake,
//! until the head of a request has arrived, between two requests, and during a request of a stranger. If all places are
//! taken, a new connection takes the place of a replaceable one: of the network that has the most of them, there first
//! one without a request, and of these the one that has waited longest. So a client that opens many connections and
//! sends no request closes only its own, and other people reach the service. WebSockets need no place: their own
//! limits apply.
//!
//! A connection with a request of a caller who has signed in (an event stream, an upload) is closed for a new one in
//! one case: no connection is replaceable, and one account has such requests on more than a quarter of all places. Of
//! these, the one that was unchanged longest is closed. So no account keeps the others out.
//!
//! A connection ends in order where it can, so that the client gets the rest of an answer that is on its way
//! ([`ConnectionPlace::must_close`]).
//!
//! A connection from a trusted proxy may carry anyone's requests, so it counts as a network of its own.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::net::IpAddr;
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use axum::body::{Body, Bytes};
use axum::response::Response;
use hyper::body::{Body as HttpBody, Frame, SizeHint};
use ipnet::IpNet;
use tokio::sync::Notify;
use tokio::time::sleep;
use tokio_util::sync::CancellationToken;

use super::auth::throttle::network_of;
use super::settings::HttpSettings;
use crate::domain::scope::Actor;

/// One account may hold this part of the places with its requests when no connection is replaceable.
const PART_OF_ONE_ACCOUNT: usize = 4;
/// How long a replaced connection may send the rest of an answer. New connections wait meanwhile.
const END_GRACE: Duration = Duration::from_millis(200);

/// The places of one listener.
#[derive(Debug)]
pub struct ConnectionPlaces(Arc<PlaceRegister>);

#[derive(Debug)]
struct PlaceRegister {
    max: usize,
    trusted_proxies: Vec<IpNet>,
    table: Mutex<PlaceTable>,
    /// A place was freed, or a connection has become replaceable.
    changed: Notify,
}

#[derive(Debug, Default)]
struct PlaceTable {
    /// The taken places, by their ids.
    taken: HashMap<u64, TakenPlace>,
    /// The ids of the replaceable ones, in the order of their replacement. No entry is empty.
    replaceable: HashMap<PlaceHolder, BTreeMap<PlaceRank, u64>>,
    /// Connections that were asked to end and still hold their places.
    ending: usize,
    /// The last number that was used, as an id or as a turn.
    last_number: u64,
}

#[derive(Debug)]
struct TakenPlace {
    holder: PlaceHolder,
    /// Grows with each beginning and end of a request.
    turn: u64,
    /// Requests in progress.
    requests: usize,
    /// Those of them whose callers have signed in.
    signed_in_requests: usize,
    /// The account of the latest of these callers, also after the request has ended.
    account: Option<Actor>,
    replaced: CancellationToken,
}

/// What counts as one client.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum PlaceHolder {
    Network(IpAddr),
    /// A connection from a trusted proxy, by its id.
    OfProxy(u64),
}

/// The order of replacement. First the connections without a request, of these first the one that waits longest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct PlaceRank {
    has_request: bool,
    turn: u64,
}

/// A taken place, freed when dropped.
#[derive(Debug)]
pub struct ConnectionPlace(PlaceHandle);

/// Names a place; clones name the same one.
#[derive(Clone, Debug)]
pub struct PlaceHandle {
    register: Arc<PlaceRegister>,
    id: u64,
    replaced: CancellationToken,
}

/// A request in progress, until the last clone is dropped.
#[derive(Clone, Debug)]
pub struct RequestInProgress(Arc<CountedRequest>);

#[derive(Debug)]
struct CountedRequest {
    place: PlaceHandle,
    is_signed_in: AtomicBool,
}

impl ConnectionPlaces {
    /// The places that these settings allow.
    pub fn new(settings: &HttpSettings) -> Self {
        Self(Arc::new(PlaceRegister {
            max: settings.max_connections,
            trusted_proxies: settings.trusted_proxies.clone(),
            table: Mutex::default(),
            changed: Notify::new(),
        }))
    }

    /// Takes a place for a connection from `peer`. If all are taken, a replaceable connection has to end. Only one
    /// task may wait here.
    pub async fn take(&self, peer: IpAddr) -> ConnectionPlace {
        loop {
            if let Some(place) = self.take_free(peer) {
                return place;
            }
            self.0.changed.notified().await;
        }
    }

    /// Takes a free place. Without one, asks a connection to end, unless one is ending already.
    fn take_free(&self, peer: IpAddr) -> Option<ConnectionPlace> {
        let mut table = self.0.lock();
        if table.taken.len() >= self.0.max {
            table.replace_one(self.0.max);
            return None;
        }
        let id = table.next_number();
        let peer = peer.to_canonical();
        let is_proxy = self.0.trusted_proxies.iter().any(|network| network.contains(&peer));
        let holder = if is_proxy { PlaceHolder::OfProxy(id) } else { PlaceHolder::Network(network_of(peer)) };
        let replaced = CancellationToken::new();
        let place = TakenPlace {
            holder,
            turn: id,
            requests: 0,
            signed_in_requests: 0,
            account: None,
            replaced: replaced.clone(),
        };
        table.offer(id, &place);
        table.taken.insert(id, place);
        Some(ConnectionPlace(PlaceHandle { register: self.0.clone(), id, replaced }))
    }
}

impl PlaceRegister {
    fn lock(&self) -> MutexGuard<'_, PlaceTable> {
        self.table.lock().unwrap_or_else(PoisonError::into_inner) // no panic leaves it half changed
    }
}

impl PlaceTable {
    fn next_number(&mut self) -> u64 {
        self.last_number += 1;
        self.last_number
    }

    /// Asks a connection to end: the first replaceable one of the network with the most of them. Without one, a
    /// connection of an account that holds too many of the `max` places.
    fn replace_one(&mut self, max: usize) {
        if self.ending > 0 {
            return;
        }
        let most = self.replaceable.values().max_by_key(|of| (of.len(), Reverse(of.keys().next())));
        let replaceable = most.and_then(|of| of.values().next().copied());
        let Some(id) = replaceable.or_else(|| self.first_of_largest_account(max)) else { return };
        let Some(place) = self.taken.remove(&id) else { return };
        self.withdraw(&place);
        place.replaced.cancel();
        self.ending += 1;
        self.taken.insert(id, place);
    }

    /// The connection to close of the account that holds the most places, if these are too many. No place may be
    /// replaceable or ending: then each has requests of an account.
    fn first_of_largest_account(&self, max: usize) -> Option<u64> {
        let mut of_accounts: HashMap<Actor, BTreeSet<(u64, u64)>> = HashMap::new();
        for (id, place) in &self.taken {
            if let Some(account) = place.account {
                of_accounts.entry(account).or_default().insert((place.turn, *id));
            }
        }
        let most = of_accounts.into_values().max_by_key(|of| (of.len(), Reverse(of.first().copied())))?;
        let (_, id) = most.first().copied()?;
        (most.len() > max / PART_OF_ONE_ACCOUNT).then_some(id)
    }

    /// Changes the requests of a place.
    fn change(&mut self, id: u64, change: impl FnOnce(&mut TakenPlace)) {
        let Some(mut place) = self.taken.remove(&id) else { return }; // the connection has ended before its request
        self.withdraw(&place);
        change(&mut place);
        place.turn = self.next_number();
        self.offer(id, &place);
        self.taken.insert(id, place);
    }

    fn free(&mut self, id: u64) {
        let Some(place) = self.taken.remove(&id) else { return };
        self.withdraw(&place);
        if place.replaced.is_cancelled() {
            self.ending -= 1;
        }
    }

    /// Adds a place to the replaceable ones, if it is one.
    fn offer(&mut self, id: u64, place: &TakenPlace) {
        if place.signed_in_requests == 0 && !place.replaced.is_cancelled() {
            self.replaceable.entry(place.holder).or_default().insert(place.rank(), id);
        }
    }

    /// Removes a place from the replaceable ones.
    fn withdraw(&mut self, place: &TakenPlace) {
        let Some(of_holder) = self.replaceable.get_mut(&place.holder) else { return };
        of_holder.remove(&place.rank());
        if of_holder.is_empty() {
            self.replaceable.remove(&place.holder);
        }
    }
}

impl TakenPlace {
    fn rank(&self) -> PlaceRank {
        PlaceRank { has_request: self.requests > 0, turn: self.turn }
    }
}

impl ConnectionPlace {
    /// Names this place.
    pub fn handle(&self) -> PlaceHandle {
        self.0.clone()
    }

    /// Resolves when the connection has to be closed, because a new one takes its place. A request ends when the last
    /// piece of its answer is taken, before the client has it. So a connection whose last caller has signed in and that
    /// serves no request has a moment for the rest of the answer, once [`PlaceHandle::replaced`] has resolved.
    pub async fn must_close(&self) {
        self.0.replaced().await;
        if self.0.may_have_unsent_answer() {
            sleep(END_GRACE).await;
        }
    }
}

impl Drop for ConnectionPlace {
    fn drop(&mut self) {
        let PlaceHandle { register, id, .. } = &self.0;
        register.lock().free(*id);
        register.changed.notify_one();
    }
}

impl PlaceHandle {
    /// Counts a request whose head has arrived.
    pub fn begin_request(&self) -> RequestInProgress {
        self.change(|place| place.requests += 1);
        RequestInProgress(Arc::new(CountedRequest { place: self.clone(), is_signed_in: AtomicBool::new(false) }))
    }

    /// Resolves when the connection has to end in order, because a new one takes its place.
    pub async fn replaced(&self) {
        self.replaced.cancelled().await;
    }

    fn may_have_unsent_answer(&self) -> bool {
        let table = self.register.lock();
        table.taken.get(&self.id).is_some_and(|place| place.requests == 0 && place.account.is_some())
    }

    fn change(&self, change: impl FnOnce(&mut TakenPlace)) {
        self.register.lock().change(self.id, change);
    }
}

impl RequestInProgress {
    /// Notes that the caller has signed in, to this account: the connection is not replaceable before the request has
    /// ended.
    pub fn caller_has_signed_in(&self, account: Actor) {
        if !self.0.is_signed_in.swap(true, Ordering::Relaxed) {
            self.0.place.change(|place| {
                place.signed_in_requests += 1;
                place.account = Some(account);
            });
        }
    }

    /// Lets the request end with the body of its answer.
    pub fn answered_by(self, answer: Response) -> Response {
        answer.map(|body| Body::new(CountedBody { body, _request: self }))
    }
}

impl Drop for CountedRequest {
    fn drop(&mut self) {
        let signed_in = usize::from(*self.is_signed_in.get_mut());
        self.place.change(|place| {
            place.requests -= 1;
            place.signed_in_requests -= signed_in;
        });
        self.place.register.changed.notify_one();
    }
}

/// A body whose request is in progress until it is dropped.
struct CountedBody {
    body: Body,
    _request: RequestInProgress,
}

impl HttpBody for CountedBody {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        Pin::new(&mut self.body).poll_frame(cx)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

#[cfg(test)]
mod tests {
    use futures_util::FutureExt;

    use super::*;
    use crate::ids::PersonId;

    const MAX: usize = 6;
    const PROXY: [u8; 4] = [10, 0, 0, 1];

    fn places() -> ConnectionPlaces {
        let trusted_proxies = vec![IpNet::from(IpAddr::from(PROXY))];
        ConnectionPlaces::new(&HttpSettings { max_connections: MAX, trusted_proxies, ..HttpSettings::default() })
    }

    fn open(places: &ConnectionPlaces, peer: [u8; 4]) -> ConnectionPlace {
        places.take_free(peer.into()).unwrap()
    }

    /// The positions of the connections that have to end.
    fn replaced(connections: &[ConnectionPlace]) -> Vec<usize> {
        (0..connections.len()).filter(|at| connections[*at].0.replaced.is_cancelled()).collect()
    }

    fn new_account() -> Actor {
        Actor::Person(PersonId::at(0))
    }

    /// Begins a request of this account.
    fn begin(place: &ConnectionPlace, account: Actor) -> RequestInProgress {
        let request = place.handle().begin_request();
        request.caller_has_signed_in(account);
        request
    }

    #[test]
    fn the_longest_waiting_connection_of_the_largest_client_is_replaced() {
        let (places, [one, many]) = (places(), [[192, 0, 2, 1], [192, 0, 2, 2]]);
        let peers = [one, many, many, many, many, one];
        let mut open: Vec<ConnectionPlace> = peers.into_iter().map(|peer| open(&places, peer)).collect();
        drop(open[1].handle().begin_request()); // it waits since now
        assert!(places.take_free(one.into()).is_none());
        assert_eq!(replaced(&open), [2]);
        assert!(places.take_free(one.into()).is_none());
        assert_eq!(replaced(&open), [2], "one at a time");
        open.remove(2);
        open.push(places.take_free(one.into()).unwrap());
        assert!(places.take_free(one.into()).is_none());
        assert_eq!(replaced(&open), [0], "both clients have three; this one waits longest");
    }

    #[test]
    fn connections_of_a_proxy_count_as_one_client_each() {
        let (places, client) = (places(), [192, 0, 2, 1]);
        let peers = [PROXY, PROXY, PROXY, PROXY, client, client];
        let open: Vec<ConnectionPlace> = peers.into_iter().map(|peer| open(&places, peer)).collect();
        assert!(places.take_free(client.into()).is_none());
        assert_eq!(replaced(&open), [4]);
    }

    #[test]
    fn requests_of_strangers_are_replaced_last_and_those_of_others_never() {
        let (places, client) = (places(), [192, 0, 2, 1]);
        let mut open: Vec<ConnectionPlace> = (0..MAX).map(|_| open(&places, client)).collect();
        let mut requests: Vec<_> = open[..MAX - 1].iter().map(|place| place.handle().begin_request()).collect();
        requests[1..].iter().for_each(|request| request.caller_has_signed_in(new_account()));
        for expected in [MAX - 1, 0] {
            assert!(places.take_free(client.into()).is_none());
            assert_eq!(replaced(&open), [expected]);
            open.remove(expected);
            if expected > 0 {
                let place = places.take_free(client.into()).unwrap();
                requests.push(begin(&place, new_account()));
                open.push(place);
            }
        }
        open.push(places.take_free(PROXY.into()).unwrap());
        let request = begin(&open[MAX - 1], new_account());
        assert!(places.take_free(client.into()).is_none());
        assert!(replaced(&open).is_empty());
        drop(request);
        assert!(places.take_free(client.into()).is_none());
        assert_eq!(replaced(&open), [MAX - 1], "its request has ended");
    }

    #[test]
    fn an_account_does_not_keep_all_places() {
        let (places, [account, other]) = (places(), [new_account(), new_account()]);
        let accounts = [new_account(), account, other, account, other, account];
        let mut open: Vec<ConnectionPlace> = accounts.iter().map(|_| open(&places, PROXY)).collect();
        let mut requests: Vec<_> = open.iter().zip(accounts).map(|(place, of)| begin(place, of)).collect();
        for (replaced_at, why) in [(1, "three of one"), (1, "two of each"), (1, "two of one")] {
            assert!(places.take_free(PROXY.into()).is_none());
            assert_eq!(replaced(&open), [replaced_at], "{why}");
            drop((open.remove(replaced_at), requests.remove(replaced_at)));
            let place = places.take_free(PROXY.into()).unwrap();
            requests.push(begin(&place, new_account()));
            open.push(place);
        }
        assert!(places.take_free(PROXY.into()).is_none());
        assert!(replaced(&open).is_empty(), "one of each");
    }

    #[tokio::test]
    async fn only_the_rest_of_an_answer_delays_the_close() {
        let replaced_after = |prepare: fn(&ConnectionPlace) -> Option<RequestInProgress>| {
            let places = ConnectionPlaces::new(&HttpSettings { max_connections: 1, ..HttpSettings::default() });
            let (place, client) = (open(&places, PROXY), IpAddr::from(PROXY));
            let request = prepare(&place);
            assert!(place.must_close().now_or_never().is_none(), "it is not replaced yet");
            assert!(places.take_free(client).is_none());
            (place, request)
        };
        let (stranger, _request) = replaced_after(|place| Some(place.handle().begin_request()));
        assert!(stranger.must_close().now_or_never().is_some());
        let (busy, _request) = replaced_after(|place| Some(begin(place, new_account())));
        assert!(busy.must_close().now_or_never().is_some());
        let (answered, _) = replaced_after(|place| {
            drop(begin(place, new_account()));
            None
        });
        assert!(answered.must_close().now_or_never().is_none());
        answered.must_close().await;
    }

    #[tokio::test]
    async fn a_new_connection_waits_until_a_place_is_free() {
        let (places, client) = (places(), IpAddr::from([192, 0, 2, 1]));
        let mut open: Vec<ConnectionPlace> = (0..MAX).map(|_| places.take_free(client).unwrap()).collect();
        let requests: Vec<_> = open.iter().map(|place| begin(place, new_account())).collect();
        let ends = async {
            drop(requests);
            open[0].0.replaced().await;
            open.remove(0);
        };
        let (_place, ()) = tokio::join!(places.take(client), ends);
        assert_eq!(places.0.lock().taken.len(), MAX);
        drop(open);
    }

    #[tokio::test]
    async fn a_request_is_in_progress_until_its_answer_is_sent() {
        let places = places();
        let place = open(&places, [192, 0, 2, 1]);
        let answer = begin(&place, new_account()).answered_by(Response::new(Body::from("answer")));
        assert_eq!(answer.body().size_hint().exact(), Some(6));
        assert!(places.0.lock().replaceable.is_empty());
        let body = axum::body::to_bytes(answer.into_body(), 100).await.unwrap();
        assert_eq!((&body[..], places.0.lock().replaceable.len()), (&b"answer"[..], 1));
    }
}
