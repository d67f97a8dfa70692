//! Self-tests of boxes: the results are kept, their recordings are not.

use std::time::Duration;

use crate::domain::blob::Blob;
use crate::domain::job::{JobInput, JobKind, NamedBlob, SelfTestInput};
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::self_test::{NewSelfTest, SelfTestReport, TrafficLight};
use crate::store::PageRequest;
use crate::store::testing::TestCentre;

const DAY: Duration = Duration::from_secs(24 * 3600);

fn report(light: TrafficLight) -> SelfTestReport {
    SelfTestReport {
        light,
        parts: vec![],
        board: "9x6".parse().unwrap(),
        square_mm: 21.0,
        placements: vec![],
        focal_change_percent: None,
        focal_sigma_percent: None,
        accuracy: None,
        holds: vec![],
        exposure_drift: None,
        white_drift_codes: None,
    }
}

/// Sends a recording and finishes its self-test.
async fn test(centre: &TestCentre, by: &Scope, recording: &Blob, light: TrafficLight) {
    let SelfTestInput { calibration, palette, .. } = send(centre, by, recording).await;
    let lease = centre.claim().await.unwrap();
    assert_eq!(lease.job.kind, JobKind::SelfTest);
    assert!(
        !centre.store.blobs().unreferenced(9).await.unwrap().contains(&recording.hash),
        "it is needed until the job ends"
    );
    let new = NewSelfTest { calibration, palette, person: by.person(), report: report(light) };
    centre.store.jobs().finish_self_test(&lease, new).await.unwrap();
}

async fn send(centre: &TestCentre, by: &Scope, recording: &Blob) -> SelfTestInput {
    let (service, of) = (Scope::service(), centre.the_box.id);
    let calibration = centre.store.calibrations().in_use(&service, of).await.unwrap().unwrap().id;
    let palette = centre.store.palettes().in_use(&service, of).await.unwrap().unwrap().id;
    let input = SelfTestInput {
        of,
        person: by.person(),
        calibration,
        palette,
        board: "9x6".parse().unwrap(),
        square_mm: 21.0,
        reach_mm: 0.0,
        file: NamedBlob { name: "test.mp4".into(), blob: *recording },
    };
    centre.store.jobs().enqueue(by, JobInput::SelfTest(input.clone())).await.unwrap();
    input
}

#[tokio::test]
async fn a_self_test_is_kept_with_its_author_and_its_recording_is_released() {
    let centre = TestCentre::with_camera_and_colours().await;
    let ines = centre.person("ines", Role::Instructor, None).await;
    centre.person("adam", Role::Administrator, None).await;
    let recording = Blob::of(b"a minute");
    test(&centre, &Scope::instructor(ines.id), &recording, TrafficLight::Yellow).await;
    let list = centre.store.self_tests().list(&Scope::service(), centre.the_box.id, &PageRequest::default()).await;
    let [kept] = &list.unwrap().items[..] else { panic!("one test") };
    assert_eq!(
        (kept.light, kept.who.as_deref(), &kept.report),
        (TrafficLight::Yellow, Some("ines"), &report(TrafficLight::Yellow))
    );
    assert_eq!(centre.store.blobs().unreferenced(9).await.unwrap(), [recording.hash]);
    assert!(centre.store.blobs().forget_if_unreferenced(recording.hash).await.unwrap());
    send(&centre, &Scope::instructor(ines.id), &recording).await;
    assert!(centre.claim().await.is_none(), "the same test is one test");
    let stray = centre.store.blobs().unreferenced(9).await.unwrap();
    assert_eq!(stray, [recording.hash], "the file was sent again and is collected again");
    centre.store.people().delete(&Scope::service(), ines.id).await.unwrap();
    let list = centre.store.self_tests().list(&Scope::service(), centre.the_box.id, &PageRequest::default()).await;
    assert_eq!(list.unwrap().items[0].who, None, "the light stays when the tester's account is deleted");
    centre.store.boxes().delete(&Scope::service(), &(&centre.the_box.code).into()).await.unwrap();
    assert_eq!(centre.store.check().await.unwrap(), Vec::<String>::new());
}

#[tokio::test]
async fn days_are_listed_from_the_newest_in_pages_and_yesterday_is_not_today() {
    let centre = TestCentre::with_camera_and_colours().await;
    let (service, of) = (Scope::service(), centre.the_box.id);
    for (day, light) in [TrafficLight::Green, TrafficLight::Red, TrafficLight::NotMeasured].into_iter().enumerate() {
        test(&centre, &service, &Blob::of(&[day as u8]), light).await;
        centre.clock.advance(DAY);
    }
    let first = centre.store.self_tests().list(&service, of, &PageRequest::new(2, None)).await.unwrap();
    let second = centre.store.self_tests().list(&service, of, &PageRequest::new(2, first.next.clone())).await.unwrap();
    let lights: Vec<TrafficLight> = first.items.iter().chain(&second.items).map(|test| test.light).collect();
    assert_eq!((lights, second.next), (vec![TrafficLight::NotMeasured, TrafficLight::Red, TrafficLight::Green], None));
    let last_ms = first.items[0].created_at_ms;
    let since = async |since_ms| centre.store.self_tests().light_since(&service, of, since_ms).await.unwrap();
    assert_eq!(since(last_ms).await.map(|test| test.light), Some(TrafficLight::NotMeasured));
    assert_eq!(since(last_ms + 1).await, None);
    // Spoils the reports: a list of boxes shows lights and must not read any figures.
    let spoil = "UPDATE self_test SET report = '{}'";
    centre.store.write(async move |tx| Ok(sqlx::query(spoil).execute(tx).await?)).await.unwrap();
    assert_eq!(since(last_ms).await.map(|test| test.light), Some(TrafficLight::NotMeasured));
}
