use super::*;
use crate::analysis::AnalysisSettings;
use crate::domain::feed::PROTOCOL;
use crate::domain::feed::messages::Hello;
use crate::domain::scope::Scope;
use crate::domain::text::Key;
use crate::events::EventBus;
use crate::ids::FeedId;
use crate::live::{ConnectResult, FeedServiceParts, LiveSettings, OpenFeeds};
use crate::queue::{Queue, QueueSettings};
use crate::sandbox::Program;
use crate::shutdown::Shutdown;
use crate::store::testing::{NOW_MS, TestCentre};
use crate::time::to_rfc3339;
use crate::vault::Vault;

/// A connection to the box of a centre.
async fn connected(centre: &TestCentre) -> Connection {
    let (store, events, clock) = (centre.store.clone(), EventBus::new(), centre.clock.clone());
    let feeds = FeedService::new(FeedServiceParts {
        vault: Vault::open(centre.folder.path()).await.unwrap(),
        queue: Queue::new(store.clone(), QueueSettings::default(), events.clone(), clock.clone()),
        store,
        events,
        clock,
        shutdown: Shutdown::new(),
        settings: LiveSettings::default(),
        analysis: AnalysisSettings::default(),
        program: Program::at("/bin/false", &[]),
        open: OpenFeeds::default(),
        cpu_slots: Arc::default(),
    });
    let hello = Hello {
        protocol: PROTOCOL,
        recording: FeedId::at(NOW_MS),
        trainee: centre.trainee("Ana").await.id.to_string(),
        task: centre.task.id.to_string(),
        codec: FrameCodec::Jpeg,
        width: 64,
        height: 48,
        time_base: TimeBase::try_from([1, 90_000]).unwrap(),
        began_at: to_rfc3339(NOW_MS),
        sender: String::new(),
        resumes: true,
    };
    match feeds.connect(&Scope::service(), &Key::from(&centre.the_box.id), hello).await.unwrap() {
        ConnectResult::Open(connection) => connection,
        ConnectResult::Ended(session) => panic!("{session} has ended"),
    }
}

#[tokio::test]
async fn a_connection_made_while_the_recording_is_ended_receives_its_session() {
    let centre = TestCentre::new().await;
    let mut connection = connected(&centre).await;
    let session = connection.feed.row.session_id;
    *connection.feed.state.lock().await = FeedState::Ended(session);
    assert_eq!(connection.welcome().await.unwrap(), ServerMessage::Ended { session, durable: None });
}

#[tokio::test]
async fn frames_that_arrive_during_a_sync_are_acknowledged_after_it() {
    let centre = TestCentre::new().await;
    let mut connection = connected(&centre).await;
    assert!(matches!(connection.welcome().await.unwrap(), ServerMessage::Welcome { .. }));
    let frame = |number: u64| RecordBody::Frame { time: 3600 * number as i64, is_key: true, payload: b"jpeg" };
    connection.take_local_record(0, frame(0)).await.unwrap();
    let first = connection.begin_sync().await.unwrap();
    assert!(!connection.is_unsynced());
    connection.take_local_record(1, frame(1)).await.unwrap();
    assert!(connection.is_unsynced(), "it arrived after the sync began");
    let second = connection.begin_sync().await.unwrap();
    assert_eq!(second.await.unwrap(), [[0, 1]]);
    assert_eq!(first.await.unwrap(), [[0, 0]], "an acknowledgement covers what arrived before its sync began");
    let mut state = connection.feed.state.lock().await;
    let records = state.records().unwrap();
    assert_eq!(records.synced, records.log.bytes(), "a sync that ends late does not lower the synced length");
}
