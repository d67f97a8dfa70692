//! A full disk: no data is lost, stored data stays readable, and the upload continues once there is space.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use reqwest::{Method, StatusCode};
use serde_json::json;
use trocar::time::SystemClock;

use super::centre::{Centre, recording};
use super::tus::Upload;
use crate::process::{Process, program};
use crate::support::{Client, Service, problem};

const MIB: usize = 1024 * 1024;

/// A small separate file system, mounted for one test; unmounted when dropped.
pub struct SmallDisk(PathBuf);

impl SmallDisk {
    /// `None` if the user may not mount a file system.
    pub fn mount(at: &Path, mib: usize) -> Option<Self> {
        let mount = ["-t", "tmpfs", "-o", &format!("size={mib}m"), "tmpfs"].map(str::to_owned);
        let mounted = Command::new("mount").args(mount).arg(at).output().ok()?.status.success();
        mounted.then(|| Self(at.to_owned()))
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("--lazy").arg(&self.0).status();
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_that_meets_a_full_disk_continues_once_there_is_space() {
    let folder = tempfile::tempdir().unwrap();
    let Some(_disk) = SmallDisk::mount(folder.path(), 64) else {
        crate::resources::skip("the right to mount a small file system");
        return;
    };
    let filler = folder.path().join("filler");
    let centre = Centre::open_in(Service::start_in(folder, Arc::new(SystemClock), |_| ()).await).await;
    let content = recording(24 * MIB, 1);
    let upload = Upload::begin(&centre.trainee, content.len()).await;
    fs::write(&filler, vec![1; 38 * MIB]).unwrap();
    let refused = problem(upload.patch(0, &content).await, 507, "disk-full").await;
    assert!(refused["detail"].as_str().unwrap().contains("space"), "{refused}");
    let kept = upload.offset().await;
    assert!(kept > 8 * MIB && kept < content.len(), "{kept} bytes are stored");
    assert_eq!(centre.trainee.get("/api/v1/sessions").await.status(), StatusCode::OK, "reading still works");
    fs::remove_file(filler).unwrap();
    let whole = upload.patch(kept, &content[kept..]).await;
    assert_eq!(whole.status(), StatusCode::NO_CONTENT, "{}", whole.text().await.unwrap());
    let head = upload.request(Method::HEAD).send().await.unwrap();
    let session = head.headers()["trocar-session"].to_str().unwrap().to_owned();
    let video = centre.trainee.get(&format!("/api/v1/sessions/{session}/video")).await;
    assert_eq!(video.bytes().await.unwrap(), content);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_service_starts_on_a_full_disk_so_that_erasing_can_make_space() {
    let folder = tempfile::tempdir().unwrap();
    let Some(_disk) = SmallDisk::mount(folder.path(), 64) else {
        crate::resources::skip("the right to mount a small file system");
        return;
    };
    let data = folder.path();
    let mut filler = fs::File::create(data.join("filler")).unwrap();
    let mut fill = || while filler.write_all(&[1; 4096]).is_ok() {};
    let service = Process::start(data);
    let password = service.password.clone().unwrap();
    let sign_in = async |service: &Process| {
        let client = Client::of(format!("http://{}", service.address));
        client.signed_in("administrator", &password).await
    };
    sign_in(&service).await.make("/api/v1/trainees", json!({"name": "Ana", "code": "ana"})).await;
    drop(service);
    let mut admin = program();
    admin.args(["admin", "user", "add", "last", "--role", "instructor", "--data"]).arg(data);
    assert!(admin.status().unwrap().success());
    assert!(!data.join("trocar.db-shm").exists(), "the last connection removes the log and its index");
    fill();
    let service = Process::start(data);
    fill();
    let administrator = sign_in(&service).await;
    assert_eq!(administrator.delete("/api/v1/trainees/ana").await.status(), StatusCode::NO_CONTENT);
}
