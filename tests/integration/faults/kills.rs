//! The service and its children killed without warning, at random moments: nothing that was acknowledged is lost, every
//! job ends, and there is one result for each session.
//!
//! `TROCAR_KILLS` is the number of kills of each: three in an ordinary run, 50 by `make kills`.

use std::time::Duration;

use sha2::{Digest, Sha256};

use super::{Centre, Dice, padded, padded_bytes};
use crate::support::let_time_pass;

/// Bytes of the recording that is uploaded: a clip with padding behind it.
const UPLOAD: usize = 24 << 20;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_acknowledged_byte_is_lost_when_the_service_is_killed_during_an_upload() {
    let mut centre = Centre::open().await;
    let recording = padded(&centre.scene("clip.mp4"), UPLOAD);
    let upload = centre.begin_upload(recording.len()).await;
    let mut dice = Dice(0x9e37_79b9_7f4a_7c15);
    let mut acknowledged = 0;
    for _ in 0..kills() {
        let piece = 1 + dice.below(UPLOAD / (2 * kills()));
        acknowledged = centre.send_until_killed(&upload, &recording, acknowledged, piece).await;
        centre.kill();
        centre.restart().await;
        let kept = centre.offset(&upload).await;
        assert!(kept >= acknowledged, "{acknowledged} bytes were acknowledged, {kept} are there");
        acknowledged = kept;
    }
    let session = centre.send_rest(&upload, &recording, acknowledged).await;
    let video = centre.get(&format!("/sessions/{session}/video")).await.bytes().await.unwrap();
    assert_eq!(Sha256::digest(&video), Sha256::digest(&recording), "the recording is complete");
    centre.ends_with_one_result(&session).await;
    eprintln!("{} kills during an upload; ready again after {:?} at most", kills(), centre.slowest_start);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn every_job_ends_with_one_result_however_often_service_and_children_are_killed() {
    let mut centre = Centre::open().await;
    let clip = std::fs::read(centre.scene("clip.mp4")).unwrap();
    let mut dice = Dice(0x2545_f491_4f6c_dd1d);
    let mut sessions = Vec::new();
    for round in 0..2 * kills() {
        let mut moment = Duration::from_millis(dice.below(400) as u64);
        loop {
            let padding = clip.len() + 16 + sessions.len(); // another length, another recording
            let session = centre.send_whole(padded_bytes(&clip, padding)).await;
            sessions.push(session.clone());
            if round % 2 == 0 {
                let_time_pass(moment).await; // a random moment for the kill
                centre.kill();
                centre.restart().await;
                break;
            }
            if centre.kill_a_child(&session, moment).await {
                break;
            }
            moment /= 2;
        }
    }
    for session in &sessions {
        centre.ends_with_one_result(session).await;
    }
    centre.kill();
    assert_eq!(centre.check(), "", "nothing is lost, and nothing is left over");
    let (kills, slowest) = (kills(), centre.slowest_start);
    eprintln!(
        "{kills} kills of the service and {kills} of children during jobs; ready again after {slowest:?} at most"
    );
}

fn kills() -> usize {
    std::env::var_os("TROCAR_KILLS").and_then(|n| n.to_str()?.parse().ok()).unwrap_or(3)
}
