use std::sync::LazyLock;

use super::*;
use crate::domain::box_agent::state::RecordingState;
use crate::ids::{PersonId, TaskId};
use crate::time::ManualClock;

static BOX: LazyLock<BoxId> = LazyLock::new(|| BoxId::at(1));

fn ada() -> (NamedTrainee, Scope) {
    let id = TraineeId::at(5);
    (NamedTrainee { id, name: "Ada".to_owned() }, Scope::trainee(PersonId::at(6), id))
}

#[tokio::test]
async fn a_command_is_answered_by_the_agent_and_fails_at_once_without_one() {
    let agents = BoxAgents::new(ManualClock::at(0));
    let stop = || AgentCommand::Stop(StopTarget::Recording(FeedId::at(3)));
    assert_eq!(agents.command(*BOX, stop()).await, Err(CommandError::Silent));
    let mut connection = agents.connect(*BOX, "agent 1".to_owned(), CheckInPage::default());
    let asking = {
        let agents = agents.clone();
        let command = stop();
        tokio::spawn(async move { agents.command(*BOX, command).await })
    };
    let Some(ToAgent::Stop { command, .. }) = connection.next().await else { panic!("no command") };
    connection.answered(command + 1, None); // another one
    connection.answered(command, Some("no recording is running".to_owned()));
    assert_eq!(asking.await.unwrap(), Err(CommandError::Refused("no recording is running".to_owned())));
}

#[tokio::test]
async fn a_box_is_silent_after_seven_seconds_and_when_its_connection_ends() {
    let clock = ManualClock::at(1_000_000);
    let agents = BoxAgents::new(clock.clone());
    assert!(!agents.view(*BOX).is_online);
    let connection = agents.connect(*BOX, String::new(), CheckInPage::default());
    connection.heard(AgentState::default());
    clock.advance(SILENT_AFTER);
    assert!(agents.view(*BOX).is_online);
    clock.advance(Duration::from_millis(1));
    let view = agents.view(*BOX);
    assert_eq!((view.is_online, view.last_seen_ms), (false, Some(1_000_000)));
    connection.heard(AgentState::default());
    assert!(agents.view(*BOX).is_online);
    drop(connection);
    assert!(!agents.view(*BOX).is_online);
}

#[tokio::test]
async fn an_old_connection_changes_nothing_after_a_new_one() {
    let agents = BoxAgents::new(ManualClock::at(0));
    let mut old = agents.connect(*BOX, String::new(), CheckInPage::default());
    let new = agents.connect(*BOX, String::new(), CheckInPage::default());
    assert_eq!(old.next().await, None, "it is to close");
    let camera = crate::domain::box_agent::state::BoxCameraState { is_open: true, ..Default::default() };
    old.heard(AgentState { camera, ..AgentState::default() });
    drop(old);
    let view = agents.view(*BOX);
    assert!(view.is_online && view.state.is_none());
    drop(new);
}

#[tokio::test]
async fn a_check_in_ends_without_a_recording_and_stays_during_one() {
    let clock = ManualClock::at(0);
    let agents = BoxAgents::new(clock.clone());
    let connection = agents.connect(*BOX, String::new(), CheckInPage::default());
    let (trainee, scope) = ada();
    agents.check_in(*BOX, trainee.clone(), scope, None);
    let session = SessionId::at(9);
    let recording = RecordingState {
        recording: FeedId::at(1),
        trainee: Some(trainee.id),
        task: Some(TaskId::at(2)),
        session: Some(session),
        recorded_s: 1.0,
        frames: 25,
    };
    let recording = AgentState { recording: Some(recording), ..AgentState::default() };
    assert!(agents.note_session(*BOX, session));
    for _ in 0..30 {
        assert!(!connection.heard(recording.clone()));
        clock.advance(Duration::from_secs(60));
    }
    assert_eq!(agents.view(*BOX).check_in.unwrap().last, Some(session));
    assert!(!connection.heard(AgentState::default()));
    clock.advance(CHECK_IN_IDLE);
    assert!(connection.heard(AgentState::default()));
    assert!(agents.view(*BOX).check_in.is_none());
}

#[tokio::test]
async fn a_used_code_is_replaced_at_once() {
    let agents = BoxAgents::new(ManualClock::at(0));
    let page = CheckInPage::At("https://trocar.example/check-in?box=1".to_owned());
    let mut connection = agents.connect(*BOX, String::new(), page);
    agents.renew_check_in_code(*BOX);
    let mut shown = async || match connection.next().await {
        Some(ToAgent::CheckInAddress { address }) => address.split_once('#').unwrap().1.to_owned(),
        other => panic!("{other:?}"),
    };
    let first = shown().await;
    assert!(!agents.use_check_in_code(*BOX, "other"));
    assert!(agents.use_check_in_code(*BOX, &first));
    let second = shown().await;
    assert_ne!(first, second);
    assert!(!agents.use_check_in_code(*BOX, &first) && agents.use_check_in_code(*BOX, &second));
}

#[test]
fn only_the_check_in_of_the_named_trainee_ends() {
    let clock = ManualClock::at(0);
    let agents = BoxAgents::new(clock.clone());
    let (trainee, scope) = ada();
    agents.check_in(*BOX, trainee.clone(), scope.clone(), None);
    assert!(!agents.end_check_in(*BOX, TraineeId::at(99), CheckInEnd::NoConsent));
    assert_eq!((agents.check_ins().len(), agents.check_in_end(*BOX)), (1, None));
    assert!(agents.end_check_in(*BOX, trainee.id, CheckInEnd::NoConsent));
    assert!(agents.check_ins().is_empty() && !agents.end_check_in(*BOX, trainee.id, CheckInEnd::NoRecord));
    // An agent that had no connection hears of it later, but not after the person has left.
    assert_eq!(agents.check_in_end(*BOX), Some(CheckInEnd::NoConsent));
    clock.advance(CHECK_IN_IDLE + Duration::from_millis(1));
    assert_eq!(agents.check_in_end(*BOX), None);
    agents.check_in(*BOX, trainee.clone(), scope.clone(), None);
    agents.end_check_in(*BOX, trainee.id, CheckInEnd::NoRecord);
    agents.check_in(*BOX, trainee, scope, None);
    assert_eq!(agents.check_in_end(*BOX), None);
}

#[test]
fn a_box_that_fell_silent_while_it_recorded_counts_as_recording_until_it_says_otherwise() {
    let clock = ManualClock::at(0);
    let agents = BoxAgents::new(clock.clone());
    let recording = RecordingState {
        recording: FeedId::at(1),
        trainee: None,
        task: None,
        session: None,
        recorded_s: 1.0,
        frames: 25,
    };
    let connection = agents.connect(*BOX, String::new(), CheckInPage::default());
    assert!(!agents.was_recording(*BOX));
    connection.heard(AgentState { recording: Some(recording), ..AgentState::default() });
    clock.advance(SILENT_AFTER + Duration::from_millis(1));
    assert!(agents.was_recording(*BOX) && !agents.view(*BOX).is_online);
    drop(connection);
    let connection = agents.connect(*BOX, String::new(), CheckInPage::default());
    assert!(agents.was_recording(*BOX), "it has not reported yet");
    connection.heard(AgentState::default());
    assert!(!agents.was_recording(*BOX));
}

#[tokio::test]
async fn a_refused_check_in_is_repeated_at_each_connection_until_a_check_in_or_for_ten_minutes() {
    let clock = ManualClock::at(1_000_000);
    let agents = BoxAgents::new(clock.clone());
    let connect = || agents.connect(*BOX, String::new(), CheckInPage::default());
    let refused = Some(ToAgent::PhoneCheckInRefused { refused_at_ms: 1_000_000 });
    let mut connection = connect();
    agents.refuse_phone_check_in(*BOX);
    assert_eq!(connection.next().await, refused);
    clock.advance(CHECK_IN_IDLE);
    assert_eq!(connect().next().await, refused, "the same one, also for an agent that had no connection");
    clock.advance(Duration::from_millis(1));
    let nothing = |mut connection: AgentConnection| connection.inbox.try_recv().is_err();
    assert!(nothing(connect()), "the person is gone");
    agents.refuse_phone_check_in(*BOX);
    let (ada, scope) = ada();
    agents.check_in(*BOX, ada, scope, None);
    assert!(nothing(connect()), "another person checked in");
}

#[tokio::test]
async fn a_box_shows_no_code_with_an_address_that_a_phone_cannot_open() {
    let agents = BoxAgents::new(ManualClock::at(0));
    let server = "http://localhost:8080".to_owned();
    let mut connection = agents.connect(*BOX, String::new(), CheckInPage::Unreachable(server.clone()));
    agents.renew_check_in_code(*BOX);
    assert_eq!(connection.next().await, Some(ToAgent::NoCheckInAddress { server: server.clone() }));
    assert_eq!(agents.view(*BOX).unreachable_server, Some(server));
    drop(connection);
    let page = CheckInPage::At("https://trocar.example/check-in?box=1".to_owned());
    let _connection = agents.connect(*BOX, String::new(), page);
    assert_eq!(agents.view(*BOX).unreachable_server, None);
}
