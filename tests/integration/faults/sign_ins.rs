//! Wrong sign-ins: each takes 19 MiB for a moment, and leaves none of it behind.

use reqwest::{Client, StatusCode};
use serde_json::json;
use tokio::task::JoinSet;

use crate::process::Process;

/// Attempts at the same time: fewer than a network's places in the queue for hashes.
const AT_ONCE: usize = 40;
/// How often as many are sent.
const ROUNDS: usize = 3;
/// Maximum memory that the service keeps of them.
const MAX_KEPT_KIB: u64 = 48 * 1024;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn many_wrong_sign_ins_leave_little_memory_behind() {
    let folder = tempfile::tempdir().unwrap();
    let service = Process::launch(folder.path(), |command| {
        command.env("TROCAR_HTTP__FREE_ATTEMPTS", "1000");
    });
    let resident_kib = || service.status("VmRSS").parse::<u64>().unwrap();
    let (http, before) = (Client::new(), resident_kib());
    for _ in 0..ROUNDS {
        let mut attempts = JoinSet::new();
        for _ in 0..AT_ONCE {
            let request = http.post(format!("http://{}/api/v1/sign-in", service.address));
            let request = request.json(&json!({"login": "administrator", "password": "a wrong password"}));
            attempts.spawn(async move { request.send().await.unwrap().status() });
        }
        let statuses = attempts.join_all().await;
        assert!(statuses.iter().all(|status| *status == StatusCode::UNAUTHORIZED), "{statuses:?}");
    }
    let kept = resident_kib().saturating_sub(before);
    eprintln!("{} wrong sign-ins left {} MiB behind", ROUNDS * AT_ONCE, kept / 1024);
    assert!(kept <= MAX_KEPT_KIB, "{kept} KiB");
}
