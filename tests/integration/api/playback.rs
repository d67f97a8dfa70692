//! Reading a recording back: whole, in part, from a cache, with a hostile file name, and without its stored file.

use reqwest::{Method, StatusCode, header};
use trocar::domain::blob::Blob;

use super::centre::{Centre, recording, session};
use crate::planted::{NEW_YEAR_MS, Planter};
use crate::support::{problem, read};

async fn centre_with_recording() -> (Centre, String, Vec<u8>) {
    let centre = Centre::open().await;
    let content = recording(10_000, 1);
    let made = session(&centre.trainee, "ada", content.clone()).await;
    let path = format!("/api/v1/sessions/{}/video", made["id"].as_str().unwrap());
    (centre, path, content)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_player_may_read_any_part() {
    let (centre, path, content) = centre_with_recording().await;
    for (range, first, last) in
        [("bytes=0-99", 0, 99), ("bytes=9000-", 9000, 9999), ("bytes=-1", 9999, 9999), ("bytes=0-99999", 0, 9999)]
    {
        let answer = centre.trainee.request(Method::GET, &path).header(header::RANGE, range).send().await.unwrap();
        assert_eq!(answer.status(), StatusCode::PARTIAL_CONTENT, "{range}");
        assert_eq!(answer.headers()[header::CONTENT_RANGE], format!("bytes {first}-{last}/10000").as_str());
        assert_eq!(answer.headers()[header::CONTENT_TYPE], "video/mp4");
        assert_eq!(answer.bytes().await.unwrap(), content[first..=last]);
    }
    let outside =
        centre.trainee.request(Method::GET, &path).header(header::RANGE, "bytes=10000-").send().await.unwrap();
    assert_eq!(outside.headers()[header::CONTENT_RANGE], "bytes */10000");
    problem(outside, 416, "range-not-satisfiable").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_head_request_gives_the_length_and_a_known_file_is_not_sent_again() {
    let (centre, path, content) = centre_with_recording().await;
    let head = centre.trainee.head(&path).await;
    assert_eq!(head.headers()[header::CONTENT_LENGTH], content.len().to_string().as_str());
    assert_eq!(head.headers()[header::ACCEPT_RANGES], "bytes");
    let etag = head.headers()[header::ETAG].clone();
    let again = centre.trainee.request(Method::GET, &path).header(header::IF_NONE_MATCH, &etag).send().await.unwrap();
    assert_eq!(again.status(), StatusCode::NOT_MODIFIED);
    let resumed = centre
        .trainee
        .request(Method::GET, &path)
        .header(header::RANGE, "bytes=5-")
        .header(header::IF_RANGE, "\"other\"");
    assert_eq!(resumed.send().await.unwrap().status(), StatusCode::OK, "another version is sent whole");
    let resumed =
        centre.trainee.request(Method::GET, &path).header(header::RANGE, "bytes=5-").header(header::IF_RANGE, &etag);
    assert_eq!(resumed.send().await.unwrap().status(), StatusCode::PARTIAL_CONTENT);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_page_sent_as_a_recording_never_runs() {
    let centre = Centre::open().await;
    let page = b"<html><script>alert(1)</script></html>".to_vec();
    let query = "trainee=ada&task=peg&box=box-1&filename=%22%3E%3Cscript%3E..%2F..%2Fx.html";
    let request = centre.trainee.request(Method::POST, &format!("/api/v1/sessions?{query}"));
    let made =
        read(request.header(header::CONTENT_TYPE, "text/html").body(page).send().await.unwrap(), StatusCode::CREATED)
            .await;
    let answer = centre.trainee.get(&format!("/api/v1/sessions/{}/video", made["id"].as_str().unwrap())).await;
    assert_eq!(answer.headers()[header::CONTENT_TYPE], "application/octet-stream");
    assert_eq!(answer.headers()[header::X_CONTENT_TYPE_OPTIONS], "nosniff");
    let disposition = answer.headers()[header::CONTENT_DISPOSITION].to_str().unwrap();
    assert!(!disposition.contains('<') && !disposition.contains('/'), "{disposition}");
}

#[tokio::test(flavor = "multi_thread")]
async fn results_that_are_not_computed_yet_are_refused_with_the_reason() {
    let (centre, path, _) = centre_with_recording().await;
    for part in ["trajectory", "trajectory?format=parquet", "preview.jpg", "diagnostics"] {
        let refused = problem(centre.trainee.get(&path.replace("video", part)).await, 409, "conflict").await;
        assert!(refused["detail"].as_str().unwrap().contains("not tracked"), "{refused}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_lost_file_is_no_fault_of_the_service_and_administrators_learn_its_name() {
    let (centre, path, content) = centre_with_recording().await;
    let file = Blob::of(&content).hash.file();
    let place = centre.service.data.path().join(&file);
    std::fs::remove_file(&place).unwrap();
    let refused = problem(centre.trainee.get(&path).await, 409, "conflict").await;
    let detail = refused["detail"].as_str().unwrap();
    assert!(detail.contains("is missing. Ask an administrator") && !detail.contains(&file), "{detail}");
    assert!(refused.get("stored_file").is_none(), "{refused}");
    let refused = problem(centre.administrator.get(&path).await, 409, "conflict").await;
    assert_eq!(refused["stored_file"], file);
    assert!(refused["detail"].as_str().unwrap().contains("Copy it from a backup"), "{refused}");
    std::fs::write(&place, &content).unwrap(); // beside the running service
    assert_eq!(centre.trainee.get(&path).await.bytes().await.unwrap(), content);

    let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    // The result goes to the recording above, whose job has waited longest. None of the result's files is stored.
    planter.session(planter.trainee("ada").await, NEW_YEAR_MS, vec![]).await;
    for part in ["trajectory", "trajectory?format=csv", "diagnostics", "diagnostics?from_frame=1"] {
        let answer = centre.administrator.get(&path.replace("video", part)).await;
        let refused = problem(answer, 409, "conflict").await;
        assert!(refused["stored_file"].as_str().unwrap().starts_with("blobs/"), "{part}: {refused}");
    }
}
