//! A full disk: it is an error of its own kind, reading and deleting still work, and writing works again once there is
//! space.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use crate::domain::password_state::PasswordState;
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::secret::{Password, PasswordHash, Secret, SecretHash};
use crate::domain::task::NewTask;
use crate::domain::text::Key;
use crate::store::{
    ActsAs, CookieLifetime, NewPerson, NewToken, PageRequest, PersonRecord, SignInOrigin, Store, StoreError,
    StoreSettings,
};
use crate::time::ManualClock;

const LASTS: CookieLifetime =
    CookieLifetime { idle: Duration::from_secs(30 * 60), max_age: Duration::from_secs(12 * 3600) };

/// A small mounted file system, unmounted at the end.
struct SmallDisk(tempfile::TempDir);

impl SmallDisk {
    /// `None` if this process may not mount file systems.
    fn mount(bytes: u64) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let size = format!("size={bytes},mode=700");
        let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", &size, "tmpfs"]).arg(folder.path()).output();
        mounted.is_ok_and(|output| output.status.success()).then(|| Self(folder))
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    /// Writes until nothing more fits.
    fn fill(&self) {
        use std::io::Write;
        let mut file = fs::File::create(self.path().join("filler")).unwrap();
        for piece in [64 * 1024, 4096, 1] {
            while file.write_all(&vec![1; piece]).is_ok() {}
        }
    }

    fn make_room(&self) {
        fs::remove_file(self.path().join("filler")).unwrap();
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(self.path()).output(); // at worst an empty mount stays
    }
}

fn task(number: usize) -> NewTask {
    let description = Some("x".repeat(4_000).parse().unwrap());
    NewTask {
        name: format!("Task {number}").parse().unwrap(),
        code: None,
        description,
        rating_forms: None,
        groups: None,
    }
}

/// Creates an administrator with a signed-in browser and a token.
async fn sign_in(store: &Store) -> (PersonRecord, PasswordHash, SecretHash, SecretHash) {
    let (service, role) = (Scope::service(), Role::Administrator);
    let (login, hash) = ("root".parse().unwrap(), Password::new("correct horse").unwrap().hash());
    let person = NewPerson {
        login,
        name: "Root".parse().unwrap(),
        role,
        password: hash.clone(),
        password_state: PasswordState::Own,
        trainee: None,
    };
    let person = store.people().create(&service, person).await.unwrap();
    let (cookie, secret) = (Secret::random().hash(), Secret::random().hash());
    store.cookies().create(cookie, (&person, &hash), LASTS, SignInOrigin::default()).await.unwrap();
    let token =
        NewToken { name: "t".parse().unwrap(), acts_as: ActsAs::Person(person.id, role), expires_at_ms: None, secret };
    store.tokens().create(&service, token).await.unwrap();
    (person, hash, cookie, secret)
}

#[tokio::test]
async fn on_a_full_disk_reading_and_erasing_go_on_and_writing_does_when_there_is_room() {
    let Some(disk) = SmallDisk::mount(16 << 20) else {
        crate::resources::skip("the right to mount a small file system");
        return;
    };
    let clock = ManualClock::at(1_000);
    let store = Store::open(&disk.path().join("trocar.db"), &StoreSettings::default(), clock.clone()).await.unwrap();
    let service = Scope::service();
    let new = serde_json::from_str(r#"{"name":"Ana"}"#).unwrap();
    let ana = store.trainees().create(&service, new).await.unwrap();
    let new = serde_json::from_str(r#"{"name":"Ben"}"#).unwrap();
    let ben = store.trainees().create(&service, new).await.unwrap();
    let (administrator, password, cookie, token) = sign_in(&store).await;
    disk.fill();
    let mut acknowledged = 0;
    let refused = loop {
        match store.tasks().create(&service, task(acknowledged)).await {
            Ok(_) => acknowledged += 1,
            Err(error) => break error,
        }
    };
    assert!(matches!(refused, StoreError::DiskFull), "{refused:?}");
    assert!(matches!(store.tasks().create(&service, task(acknowledged)).await, Err(StoreError::DiskFull)));

    let page = PageRequest::new(200, None);
    assert_eq!(store.tasks().list(&service, &page).await.unwrap().items.len(), acknowledged);
    clock.advance(Duration::from_secs(120)); // so that the last-seen time is due
    assert_eq!(store.cookies().person_of(cookie, LASTS).await.unwrap().unwrap().person.id, administrator.id);
    assert!(store.tokens().scope_of(token).await.unwrap().is_some());
    store
        .cookies()
        .create(Secret::random().hash(), (&administrator, &password), LASTS, SignInOrigin::default())
        .await
        .unwrap();
    store.cookies().delete_replaced(cookie).await.unwrap();
    assert_eq!(fs::metadata(disk.path().join("ballast")).unwrap().len(), 4 << 20, "kept for deletions");
    disk.fill(); // the space that the sign-in has freed
    while store.tasks().create(&service, task(acknowledged)).await.is_ok() {
        acknowledged += 1;
    }
    store.pending_erasures().request(&service, &Key::from(&ben.id), Duration::from_secs(60)).await.unwrap();
    assert_eq!(store.pending_erasures().list(&service).await.unwrap().len(), 1);
    store.trainees().erase(&service, &Key::from(&ana.id)).await.unwrap();
    assert!(store.trainees().get(&service, &Key::from(&ana.id)).await.is_err());

    disk.make_room();
    store.tasks().create(&service, task(acknowledged)).await.unwrap();
    assert_eq!(store.tasks().list(&service, &page).await.unwrap().items.len(), acknowledged + 1);
    store.restore_reserves().await;
    assert_eq!(fs::metadata(disk.path().join("ballast")).unwrap().len(), 4 << 20);
    assert_eq!(store.check().await.unwrap(), Vec::<String>::new());
}

#[tokio::test]
async fn a_database_opens_on_a_full_disk_with_a_part_of_the_reserve_and_keeps_the_rest_for_erasing() {
    let Some(disk) = SmallDisk::mount(16 << 20) else {
        crate::resources::skip("the right to mount a small file system");
        return;
    };
    let (path, clock, service) = (disk.path().join("trocar.db"), ManualClock::at(1_000), Scope::service());
    let open = async || Store::open(&path, &StoreSettings::default(), clock.clone()).await;
    let ballast = disk.path().join("ballast");
    let store = open().await.unwrap();
    let new = serde_json::from_str(r#"{"name":"Ana"}"#).unwrap();
    let ana = store.trainees().create(&service, new).await.unwrap();
    store.close().await; // removes the log and its index, which need space again
    disk.fill();
    let store = open().await.unwrap();
    assert_eq!(fs::metadata(&ballast).unwrap().len(), 3 << 20);
    disk.fill();
    let mut number = 0;
    while store.tasks().create(&service, task(number)).await.is_ok() {
        number += 1;
    }
    store.trainees().erase(&service, &Key::from(&ana.id)).await.unwrap();
    store.close().await;
    let _ = fs::remove_file(&ballast); // the erasure may have used it already
    disk.fill();
    let refused = open().await.unwrap_err();
    let advice = format!("the disk of `{}` is full: free at least 1 MiB", disk.path().display());
    assert_eq!(refused.to_string(), advice);
    assert!(!disk.path().join("ballast-opening").exists());
    disk.make_room();
    open().await.unwrap();
    assert_eq!(fs::metadata(&ballast).unwrap().len(), 4 << 20);
}
