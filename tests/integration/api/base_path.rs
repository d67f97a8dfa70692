//! The service under a path of its host, as behind a proxy that passes the path on.

use std::path::Path;

use reqwest::{Method, StatusCode, header};
use serde_json::{Value, json};

use super::centre::{Centre, recording, send};
use super::tus::Upload;
use crate::feed::sender;
use crate::support::{ADMINISTRATOR, Client, Service, problem};

async fn service_below(path: &str) -> Service {
    Service::start_with(|settings| settings.http.base_path = path.parse().unwrap()).await
}

/// A client that names each path from the root of the host.
fn outside(service: &Service) -> Client {
    Client::of(format!("http://{}", service.address()))
}

#[tokio::test(flavor = "multi_thread")]
async fn every_address_of_a_page_lies_below_the_path() {
    let service = service_below("/skills/trocar").await;
    let host = outside(&service);
    for path in ["/skills/trocar/", "/skills/trocar", "/skills/trocar/sessions/some-id?t=3"] {
        let page = host.get(path).await;
        assert_eq!(page.status(), StatusCode::OK, "{path}");
        let page = page.text().await.unwrap();
        assert!(page.contains("data-base-path=\"/skills/trocar\"") && !page.contains("BASE_PATH"), "{page}");
        let quoted: Vec<_> = page.split('"').filter(|word| word.starts_with('/')).collect();
        assert!(quoted.len() > 20, "{page}");
        for address in quoted {
            assert!(address.starts_with("/skills/trocar"), "{address}");
            let status = host.get(address).await.status();
            let is_file = !address.ends_with("/api/v1/me"); // needs a sign-in
            assert_eq!(status, if is_file { StatusCode::OK } else { StatusCode::UNAUTHORIZED }, "{address}");
        }
    }
}

#[test]
fn no_script_or_style_names_an_address_from_the_root_of_the_host() {
    let pages = Path::new(env!("CARGO_MANIFEST_DIR")).join("static");
    let (mut folders, mut read, mut found) = (vec![pages], 0, Vec::new());
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let suffix = path.extension().unwrap_or_default().to_owned();
            if path.is_dir() && !path.ends_with("vendor") {
                folders.push(path);
            } else if suffix == "js" || suffix == "css" {
                read += 1;
                let text = std::fs::read_to_string(&path).unwrap();
                let roots = ["api/", "docs", "kept/"]
                    .into_iter()
                    .flat_map(|to| ["'/", "\"/", "`/", "(/", "=/", "origin}/"].map(|before| format!("{before}{to}")));
                found.extend(roots.filter(|root| text.contains(root)).map(|root| (path.clone(), root)));
            }
        }
    }
    assert!(read > 50, "{read} files were read");
    assert!(found.is_empty(), "use `basePath` of base_path.js: {found:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn outside_the_path_there_are_only_probes_and_the_way_in() {
    let service = service_below("/trocar").await;
    let host = outside(&service);
    let root = host.get("/").await;
    assert_eq!(
        (root.status(), &root.headers()[header::LOCATION]),
        (StatusCode::TEMPORARY_REDIRECT, &"/trocar/".parse().unwrap())
    );
    for path in ["/healthz", "/readyz", "/metrics", "/trocar/healthz"] {
        assert_eq!(host.get(path).await.status(), StatusCode::OK, "{path}");
    }
    for path in ["/api/v1/me", "/trocars/", "/sessions", "/docs/"] {
        let answer = host.get(path).await;
        assert!(answer.headers().contains_key(header::CONTENT_SECURITY_POLICY), "{path}");
        problem(answer, 404, "not-found").await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_cookies_belong_to_the_path_and_sign_in() {
    let service = service_below("/trocar").await;
    let answer = service
        .stranger()
        .post("/api/v1/sign-in", json!({"login": ADMINISTRATOR.0, "password": ADMINISTRATOR.1}))
        .await;
    let cookies: Vec<_> =
        answer.headers().get_all(header::SET_COOKIE).iter().map(|set| set.to_str().unwrap()).collect();
    assert_eq!(cookies.len(), 2);
    for (cookie, name) in cookies.iter().zip(["__Secure-trocar=", "__Secure-trocar-browser="]) {
        assert!(cookie.starts_with(name) && cookie.split("; ").any(|part| part == "Path=/trocar"), "{cookie}");
    }
    let administrator = service.administrator().await;
    assert_eq!(administrator.read("/api/v1/me").await["login"], "administrator");
    let out = administrator.post("/api/v1/sign-out", json!({})).await;
    let removed = out.headers()[header::SET_COOKIE].to_str().unwrap();
    assert!(removed.starts_with("__Secure-trocar=;") && removed.contains("Path=/trocar"), "{removed}");
    problem(administrator.get("/api/v1/me").await, 401, "not-signed-in").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn every_address_that_an_answer_states_works_as_it_is() {
    let centre = Centre::open_in(service_below("/trocar").await).await;
    let host = outside(&centre.service).with("cookie", &centre.trainee.cookie());
    let works = async |address: &str| {
        assert!(address.starts_with("/trocar/"), "{address}");
        assert_eq!(host.get(address).await.status(), StatusCode::OK, "{address}");
    };
    let content = recording(1000, 1);
    let upload = Upload::begin(&centre.trainee, content.len()).await;
    assert!(upload.address.starts_with("/trocar/api/v1/uploads/"), "{}", upload.address);
    let half = upload.patch(0, &content[..400]).await;
    assert_eq!((half.status(), upload.offset().await), (StatusCode::NO_CONTENT, 400));
    assert!(upload.patch(400, &content[400..]).await.headers().contains_key("trocar-session"));

    let again = problem(send(&centre.trainee, "ada", content).await, 409, "duplicate-recording").await;
    works(again["session"].as_str().unwrap()).await;
    let made = send(&centre.trainee, "ada", recording(1000, 2)).await;
    works(made.headers()[header::LOCATION].to_str().unwrap()).await;
    let replaced = host.get("/trocar/api/v1/trainees/ada/course").await;
    let link = replaced.headers()[header::LINK].to_str().unwrap().to_owned();
    works(link.split(['<', '>']).nth(1).unwrap()).await;
    works(host.get("/trocar/docs").await.headers()[header::LOCATION].to_str().unwrap()).await;
    let viewer = host.get("/trocar/docs/swagger-initializer.js").await.text().await.unwrap();
    assert!(viewer.contains("\"/trocar/api/v1/openapi.json\""), "{viewer}");
    let document: Value = host.read("/trocar/api/v1/openapi.json").await;
    assert_eq!(document["servers"], json!([{"url": "/trocar"}]));
}

#[tokio::test(flavor = "multi_thread")]
async fn feeds_and_events_arrive_below_the_path() {
    let centre = Centre::open_in(service_below("/trocar").await).await;
    let events = centre.trainee.request(Method::GET, "/api/v1/events").send().await.unwrap();
    assert_eq!(events.headers()[header::CONTENT_TYPE], "text/event-stream");
    let id = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44";
    let (mut sender, welcome) = sender::begin(&centre.service, &centre.agent, id).await;
    sender.send_frames(0..2).await;
    sender.wait_for_ack(json!([[0, 1]])).await;
    let session = centre.trainee.read(&format!("/api/v1/sessions/{}", welcome["session"].as_str().unwrap())).await;
    assert_eq!(session["status"], "receiving");
}

#[tokio::test(flavor = "multi_thread")]
async fn without_the_setting_addresses_begin_at_the_root() {
    let service = Service::start().await;
    let page = service.stranger().get("/").await.text().await.unwrap();
    assert!(page.contains("data-base-path=\"\"") && page.contains("href=\"/api/v1/me\""), "{page}");
    assert_eq!(service.stranger().get("/docs").await.headers()[header::LOCATION], "/docs/");
    assert!(service.stranger().read("/api/v1/openapi.json").await["servers"].is_null());
}
