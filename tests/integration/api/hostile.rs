//! Malicious clients, and clients that are broken in the same ways.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use reqwest::{Method, StatusCode, header};
use serde_json::json;

use super::centre::Centre;
use crate::support::{ADMINISTRATOR, Service, problem};

/// Sends bytes and returns the service's answer until it closes the connection.
fn send_raw(service: &Service, bytes: &[u8]) -> String {
    let mut stream = TcpStream::connect(service.address()).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    stream.write_all(bytes).unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    String::from_utf8_lossy(&answer).into_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn another_sites_page_changes_nothing() {
    let centre = Centre::open().await;
    for (name, value) in [("origin", "http://evil.example"), ("origin", "null"), ("sec-fetch-site", "cross-site")] {
        let cross_site = centre.administrator.clone().with(name, value);
        problem(cross_site.post("/api/v1/tasks", json!({"name": "planted"})).await, 403, "foreign-origin").await;
        problem(cross_site.delete("/api/v1/tasks/peg").await, 403, "foreign-origin").await;
        assert_eq!(cross_site.get("/api/v1/tasks").await.status(), StatusCode::OK);
    }
    let own = format!("http://{}", centre.service.address());
    let ours = centre.administrator.clone().with("origin", &own);
    assert_eq!(ours.post("/api/v1/tasks", json!({"name": "ours"})).await.status(), StatusCode::CREATED);
    let login = json!({"login": ADMINISTRATOR.0, "password": ADMINISTRATOR.1});
    let cross_site = centre.service.stranger().with("origin", "http://evil.example");
    problem(cross_site.post("/api/v1/sign-in", login).await, 403, "foreign-origin").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn bodies_that_are_too_long_wrong_or_broken_are_explained() {
    let centre = Centre::open().await;
    let post = |kind: &'static str, body: String| {
        centre.administrator.request(Method::POST, "/api/v1/tasks").header(header::CONTENT_TYPE, kind).body(body).send()
    };
    let long = format!("{{\"name\":\"{}\"}}", "x".repeat(300_000));
    let refused = problem(post("application/json", long).await.unwrap(), 413, "too-large").await;
    assert_eq!(refused["limit_bytes"], 256 * 1024);
    for path in ["/api/v1/sign-in", "/api/v1/password-links/open", "/api/v1/password-links/use"] {
        let long = json!({"login": "x".repeat(4096), "secret": "x"});
        let refused = problem(centre.service.stranger().post(path, long).await, 413, "too-large").await;
        assert_eq!(refused["limit_bytes"], 4096, "{path}");
    }
    problem(post("text/plain", "{\"name\":\"x\"}".into()).await.unwrap(), 415, "unsupported-media-type").await;
    problem(post("application/json", "{\"name\":".into()).await.unwrap(), 400, "bad-request").await;
    for body in
        ["{}", "[]", "{\"name\":5}", "{\"name\":\"\"}", "{\"name\":\"x\",\"colour\":\"red\"}", "{\"name\":\"a\\nb\"}"]
    {
        problem(post("application/json", body.into()).await.unwrap(), 422, "invalid").await;
    }
    let deep = post("application/json", format!("{{\"name\":{}", "[".repeat(100_000))).await.unwrap();
    problem(deep, 422, "invalid").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_form_whose_part_has_no_end_of_its_head_is_refused_early() {
    let centre = Centre::open().await;
    let head = format!(
        "POST /api/v1/boxes/box-1/palettes HTTP/1.1\r\nHost: x\r\nCookie: {}\r\nContent-Length: {}\r\n\
         Content-Type: multipart/form-data; boundary=edge\r\n\r\n\
         --edge\r\nContent-Disposition: form-data; name=\"annotations\"\r\nX-More: ",
        centre.administrator.cookie(),
        64 << 20
    );
    // The service answers without the other 63 MiB.
    let answer = send_raw(&centre.service, format!("{head}{}", "a".repeat(1 << 20)).as_bytes());
    assert!(answer.starts_with("HTTP/1.1 400"), "{answer}");
    assert!(answer.contains("longer than 65536 bytes"), "{answer}");
}

#[tokio::test(flavor = "multi_thread")]
async fn numbers_that_nothing_can_have_are_refused() {
    let centre = Centre::open().await;
    let camera = json!({"width": 70_000, "height": 480, "fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0,
        "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0, "k3": 0.0});
    let put = centre.administrator.request(Method::PUT, "/api/v1/boxes/box-1/camera").json(&camera).send();
    problem(put.await.unwrap(), 422, "invalid").await;
    for (key, value) in [("cx", 6400.0), ("fy", 50.0), ("fx", 9.0), ("k1", -1.5)] {
        let mut camera = json!({"width": 640, "height": 480, "fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0});
        camera[key] = json!(value);
        let put = centre.administrator.request(Method::PUT, "/api/v1/boxes/box-1/camera").json(&camera).send();
        let refused = problem(put.await.unwrap(), 422, "invalid").await;
        assert!(refused["errors"][0]["message"].as_str().is_some_and(|text| text.contains(key)), "{refused}");
    }
    for recorded_at in ["2099-01-01T00:00:00Z", "1961-01-01T00:00:00Z", "-009999-01-02T01:59:59Z", "yesterday"] {
        let path = format!("/api/v1/sessions?trainee=ada&task=peg&box=box-1&recorded_at={recorded_at}");
        let sent = centre.administrator.request(Method::POST, &path).header(header::CONTENT_TYPE, "video/mp4");
        let refused = problem(sent.body("no video").send().await.unwrap(), 422, "invalid").await;
        assert_eq!(refused["errors"][0]["field"], "recorded_at", "{refused}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn hostile_heads_are_refused_and_the_service_keeps_running() {
    let service = Service::start().await;
    let many = format!("GET / HTTP/1.1\r\nHost: x\r\n{}\r\n", "a: b\r\n".repeat(1000));
    let long = format!("GET /{} HTTP/1.1\r\nHost: x\r\n\r\n", "a".repeat(1_000_000));
    let smuggled = "POST /api/v1/sign-in HTTP/1.1\r\nHost: x\r\nContent-Length: 4\r\nTransfer-Encoding: chunked\r\nConnection: close\r\n\r\n0\r\n\r\n";
    for (bytes, statuses) in [
        (many.as_str(), &["431"][..]),
        (long.as_str(), &["414", "431"]),
        (smuggled, &["400", "415"]),
        ("GET / HTTP/9.9\r\n\r\n", &["400", "505"]),
        ("\x16\x03\x01\x02\x00\x01\x00\x01", &["400"]),
        ("GET /api/v1/sessions/%ff%00/../x HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n", &["401", "404"]),
        ("GET /../../etc/passwd HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n", &["404", "200"]),
        ("GET /healthz HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n", &["200"]),
        ("GET /healthz HTTP/1.1\r\nConnection: close\r\n\r\n", &["400"]),
        ("GET /healthz HTTP/1.1\r\nHost: x\r\nHost: y\r\nConnection: close\r\n\r\n", &["400"]),
        ("GET /healthz HTTP/1.0\r\n\r\n", &["200"]),
        ("GET /healthz HTTP/1.0\r\nHost: x\r\nHost: x\r\n\r\n", &["400"]),
    ] {
        let answer = send_raw(&service, bytes.as_bytes());
        let status = answer.split(' ').nth(1).unwrap_or_default();
        assert!(statuses.contains(&status), "{}: {answer:.200}", &bytes[..bytes.len().min(60)]);
        assert!(!answer.contains("root:"), "{answer}");
    }
    service.administrator().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_silent_client_and_a_slow_body_are_disconnected() {
    let service = Service::start_with(|settings| {
        settings.http.head_timeout_s = 0.1;
        settings.http.body_grace_s = 0.1;
    })
    .await;
    assert_eq!(send_raw(&service, b""), "", "closed without an answer");
    send_raw(&service, b"GET / HTTP/1.1\r\nHost:");
    let head =
        "POST /api/v1/sign-in HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\nContent-Length: 100\r\n\r\n{";
    let answer = send_raw(&service, head.as_bytes());
    assert!(answer.starts_with("HTTP/1.1 408"), "{answer}");
    assert!(answer.contains("/problems/too-slow"), "{answer}");
    service.administrator().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn names_are_never_markup() {
    let centre = Centre::open().await;
    let name = "<script>alert(1)</script>";
    let made = centre.administrator.make("/api/v1/tasks", json!({"name": name})).await;
    let answer = centre.administrator.get(&format!("/api/v1/tasks/{}", made["id"].as_str().unwrap())).await;
    assert_eq!(answer.headers()[header::CONTENT_TYPE], "application/json");
    assert_eq!(answer.headers()[header::X_CONTENT_TYPE_OPTIONS], "nosniff");
    assert_eq!(made["name"], name, "kept as it was typed");
}

#[tokio::test(flavor = "multi_thread")]
async fn every_answer_forbids_inline_code_foreign_frames_and_foreign_use_of_the_camera() {
    let service = Service::start().await;
    let stranger = service.stranger();
    for path in ["/", "/docs/", "/api/v1/me", "/healthz", "/nothing.js", "/api/v1/openapi.json"] {
        let answer = stranger.get(path).await;
        let policy = answer.headers()[header::CONTENT_SECURITY_POLICY].to_str().unwrap();
        assert!(policy.contains("default-src 'none'") && policy.contains("frame-ancestors 'none'"), "{path}");
        assert!(!policy.contains("unsafe"), "{path}: {policy}");
        assert_eq!(answer.headers()[header::X_CONTENT_TYPE_OPTIONS], "nosniff", "{path}");
        let device = answer.headers()["permissions-policy"].to_str().unwrap();
        assert!(device.contains("camera=(self)") && device.contains("microphone=()"), "{path}: {device}");
        assert!(answer.headers().contains_key("x-request-id"), "{path}");
        assert!(answer.headers().contains_key(header::CACHE_CONTROL), "{path}");
    }
}
