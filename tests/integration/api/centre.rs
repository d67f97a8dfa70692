//! A small centre: two groups with an instructor and a trainee each, and a box and a task that both groups own.

use reqwest::{Method, Response, StatusCode, header};
use serde_json::{Value, json};

use crate::support::{Client, Service, read};

pub const PASSWORD: &str = "a password of tests";

pub struct Centre {
    pub service: Service,
    pub administrator: Client,
    /// Teaches group one.
    pub instructor: Client,
    /// Teaches group two.
    pub other_instructor: Client,
    /// Trains in group one, as `ada`.
    pub trainee: Client,
    /// Trains in group two, as `bob`.
    pub other_trainee: Client,
    /// The box's agent: the program that runs beside the box.
    pub agent: Client,
}

impl Centre {
    pub async fn open() -> Self {
        Self::open_in(Service::start().await).await
    }

    pub async fn open_in(service: Service) -> Self {
        let administrator = service.administrator().await;
        let mut groups = Vec::new();
        for (trainee, instructor, group) in [("ada", "ines", "One"), ("bob", "omar", "Two")] {
            groups.push(create_group(&administrator, group, trainee, instructor).await);
        }
        administrator.make("/api/v1/boxes", json!({"name": "Box 1", "code": "box-1", "groups": groups})).await;
        administrator.make("/api/v1/tasks", json!({"name": "Peg transfer", "code": "peg", "groups": groups})).await;
        let token = json!({"name": "beside box 1", "role": "agent", "box": "box-1"});
        let token = administrator.make("/api/v1/tokens", token).await;
        Self {
            instructor: service.sign_in("ines", PASSWORD).await,
            other_instructor: service.sign_in("omar", PASSWORD).await,
            trainee: service.sign_in("ada", PASSWORD).await,
            other_trainee: service.sign_in("bob", PASSWORD).await,
            agent: service.stranger().with_token(token["token"].as_str().unwrap()),
            administrator,
            service,
        }
    }
}

/// Replaces the members of a group; `trainees` are codes.
pub async fn set_members(centre: &Centre, group: &str, instructors: &[&str], trainees: &[&str]) {
    let people = centre.administrator.read("/api/v1/people").await;
    let account = |login: &&str| {
        people["items"].as_array().unwrap().iter().find(|one| one["login"] == **login).unwrap()["id"].clone()
    };
    let mut members = json!({"instructors": instructors.iter().map(account).collect::<Vec<_>>(), "trainees": []});
    for code in trainees {
        let trainee = centre.administrator.read(&format!("/api/v1/trainees/{code}")).await;
        members["trainees"].as_array_mut().unwrap().push(trainee["id"].clone());
    }
    let groups = centre.administrator.read("/api/v1/groups").await;
    let found = groups["items"].as_array().unwrap().iter().find(|one| one["name"] == group).unwrap();
    let path = format!("/api/v1/groups/{}/members", found["id"].as_str().unwrap());
    assert!(centre.administrator.put(&path, members).await.status().is_success());
}

/// Creates a group with its people. Returns the group's id.
async fn create_group(administrator: &Client, group: &str, trainee: &str, instructor: &str) -> Value {
    let group = administrator.make("/api/v1/groups", json!({"name": group})).await;
    let trainee_row =
        administrator.make("/api/v1/trainees", json!({"name": trainee, "code": trainee, "group": group["id"]})).await;
    let account = json!({"login": trainee, "name": trainee, "role": "trainee", "password": PASSWORD, "trainee": trainee_row["id"]});
    administrator.make("/api/v1/people", account).await;
    let account = json!({"login": instructor, "name": instructor, "role": "instructor", "password": PASSWORD, "groups": [group["id"]]});
    administrator.make("/api/v1/people", account).await;
    group["id"].clone()
}

/// Bytes that look like a recording; no worker analyses them. Each `salt` gives different bytes.
pub fn recording(bytes: usize, salt: u64) -> Vec<u8> {
    let mut content = b"\0\0\0\x20ftypisom\0\0\x02\0isomiso2avc1mp41".to_vec();
    let mut state = salt.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    content.resize_with(bytes.max(32), || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state as u8
    });
    content
}

/// Sends a recording in one request.
pub async fn send(client: &Client, trainee: &str, content: Vec<u8>) -> Response {
    let path = format!("/api/v1/sessions?trainee={trainee}&task=peg&box=box-1&filename=clip.mp4");
    let request = client.request(Method::POST, &path).header(header::CONTENT_TYPE, "video/mp4").body(content);
    request.send().await.unwrap()
}

/// Creates a session from a recording.
pub async fn session(client: &Client, trainee: &str, content: Vec<u8>) -> Value {
    read(send(client, trainee, content).await, StatusCode::CREATED).await
}
