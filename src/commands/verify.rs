//! `trocar verify`: is a certificate genuine, what does it say, and is it still valid?
//!
//! The signature needs only the centre's public key. Whether a certificate was withdrawn is known to the centre alone: to
//! its data folder, or to its server.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use serde::Deserialize;

use super::upload::client::{RequestError, ServiceClient};
use super::{CommandFailure, admin, print_result};
use crate::domain::certificate::key::CertificatePublicKey;
use crate::domain::certificate::signed_file::{self, MAX_FILE_BYTES, SignatureVerdict};
use crate::domain::certificate::{CertificateCode, CertificateContent, CertificateState, CertifiedExam};
use crate::domain::exam::IdentityCheck;
use crate::settings::{Flags, Settings};
use crate::time::Day;

/// Arguments of `trocar verify`.
#[derive(clap::Args)]
#[command(
    after_help = "Exit status: 0 genuine and, with --data or --server, valid; 1 anything else, such as changed, \
                        withdrawn or under review; 2 the file, the key, the folder or the server cannot be read."
)]
pub struct VerifyArgs {
    /// The certificate: the PDF file as it was issued
    file: PathBuf,
    /// The centre's public key, a PEM file; says only whether the certificate is genuine
    #[arg(long, value_name = "FILE", group = "source")]
    key: Option<PathBuf>,
    /// Data folder of the service; says also whether the certificate is valid [default: trocar-data]
    #[arg(long, value_name = "DIR", group = "source")]
    data: Option<PathBuf>,
    /// Address of the centre's server; says also whether the certificate is valid
    #[arg(long, value_name = "URL", group = "source")]
    server: Option<String>,
}

/// The state of a certificate, as its centre knows it.
struct KnownState {
    state: CertificateState,
    /// What the centre's own certificate says; `None` if it was erased.
    content: Option<CertificateContent>,
    /// The day since when.
    day: String,
    reason: Option<String>,
}

/// Where the keys come from.
enum Source {
    KeyFile,
    Data(Box<crate::store::Store>),
    Server(Box<ServiceClient>),
}

/// Runs the command.
pub fn run(args: VerifyArgs) -> Result<(), CommandFailure> {
    let file = read_file(&args.file)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().context("starting the runtime")?;
    runtime.block_on(verify(args, &file))
}

async fn verify(args: VerifyArgs, file: &[u8]) -> Result<(), CommandFailure> {
    let (keys, source) = keys_and_source(args).await?;
    let content = match signed_file::verify(file, &keys) {
        SignatureVerdict::Genuine { content, .. } => content,
        SignatureVerdict::Changed => {
            return Err(refused("CHANGED: this file is not as it was signed. Do not rely on it"));
        }
        SignatureVerdict::UnknownKey { key } => {
            let why = format!(
                "UNKNOWN KEY: the file names the key {key}, which is none of this centre's. It is of another centre, or forged"
            );
            return Err(refused(why));
        }
        SignatureVerdict::NotACertificate => return Err(refused("NOT A CERTIFICATE: Trocar did not make this file")),
    };
    print_result(&facts(&content))?;
    let known = match &source {
        Source::KeyFile => {
            return print_result(
                "Genuine. Whether it was withdrawn is known to the centre only: use --server or --data.\n",
            );
        }
        Source::Data(store) => state_in(store, &content.code).await?,
        Source::Server(client) => state_at(client, &content.code).await?,
    };
    verdict(known, &content)
}

/// The centre's word on a genuine certificate.
fn verdict(known: Option<KnownState>, shown: &CertificateContent) -> Result<(), CommandFailure> {
    // A person with the key, as of a stolen backup, could sign another name under a code that the centre knows.
    let issued = known.filter(|known| known.content.as_ref().is_none_or(|content| content == shown));
    let Some(KnownState { state, day, reason, .. }) = issued else {
        let why = "UNKNOWN: the signature is genuine, but the centre has no such certificate. Ask the centre";
        return Err(refused(why));
    };
    match state {
        CertificateState::Valid => print_result("Genuine and valid.\n"),
        CertificateState::UnderReview => Err(refused(format!(
            "UNDER REVIEW since {day}: genuine, but a session that it relied on was moved, erased or changed. Ask the centre"
        ))),
        CertificateState::Withdrawn => {
            let reason = reason.unwrap_or_default();
            Err(refused(format!("WITHDRAWN on {day}: genuine, but no longer valid. Reason: {reason}")))
        }
        CertificateState::Erased => Err(refused(format!(
            "ERASED on {day}: the data of this person were erased, and the certificate with them. It is no longer valid"
        ))),
    }
}

fn refused(why: impl Into<String>) -> CommandFailure {
    CommandFailure::Failed(anyhow!("{}", why.into()))
}

fn read_file(path: &Path) -> Result<Vec<u8>, CommandFailure> {
    let mut bytes = Vec::new();
    let shown = path.display();
    let file = File::open(path).with_context(|| format!("reading {shown}")).map_err(CommandFailure::Input)?;
    let read = file.take(MAX_FILE_BYTES as u64 + 1).read_to_end(&mut bytes);
    read.with_context(|| format!("reading {shown}")).map_err(CommandFailure::Input)?;
    Ok(bytes)
}

async fn keys_and_source(args: VerifyArgs) -> Result<(Vec<CertificatePublicKey>, Source), CommandFailure> {
    if let Some(path) = args.key {
        let text = String::from_utf8_lossy(&read_file(&path)?).into_owned();
        let keys = CertificatePublicKey::all_of_pem(&text).with_context(|| path.display().to_string());
        return Ok((keys.map_err(CommandFailure::Input)?, Source::KeyFile));
    }
    if let Some(address) = args.server {
        let client =
            ServiceClient::anonymous(&address).map_err(|why| CommandFailure::input(anyhow!("--server: {why}")))?;
        let keys = client.read_all("/certificate-keys").await.map_err(unreachable_server)?;
        let pem: String = keys.iter().filter_map(|key| key["pem"].as_str()).collect();
        let keys = if pem.is_empty() { Ok(Vec::new()) } else { CertificatePublicKey::all_of_pem(&pem) };
        return Ok((keys.map_err(CommandFailure::input)?, Source::Server(Box::new(client))));
    }
    let flags = Flags { data: args.data, ..Flags::default() };
    let settings = Settings::load(flags).map_err(CommandFailure::input)?;
    let store = admin::open_store_to_read(&settings).await?;
    let keys = store.certificates().keys().await.context("reading the keys").map_err(CommandFailure::Input)?;
    Ok((keys.into_iter().map(|key| key.public).collect(), Source::Data(Box::new(store))))
}

fn unreachable_server(error: RequestError) -> CommandFailure {
    CommandFailure::input(anyhow!("asking the server: {error}"))
}

async fn state_in(store: &crate::store::Store, code: &CertificateCode) -> Result<Option<KnownState>, CommandFailure> {
    let found = store.certificates().published(code).await.context("reading the certificate")?;
    Ok(found.map(|found| KnownState {
        state: found.state,
        content: found.content,
        day: Day::of(found.state_at_ms).to_string(),
        reason: found.reason.map(String::from),
    }))
}

/// The parts of the server's answer that are used.
#[derive(Deserialize)]
struct ServerAnswer {
    state: CertificateState,
    content: Option<CertificateContent>,
    state_at: String,
    reason: Option<String>,
}

async fn state_at(client: &ServiceClient, code: &CertificateCode) -> Result<Option<KnownState>, CommandFailure> {
    match client.read(&format!("/certificate-checks/{code}")).await {
        Ok(answer) => {
            let answer: ServerAnswer = serde_json::from_value(answer).context("reading the server's answer")?;
            let day = answer.state_at.chars().take(10).collect();
            Ok(Some(KnownState { state: answer.state, content: answer.content, day, reason: answer.reason }))
        }
        Err(RequestError::Refused { status, .. }) if status.as_u16() == 404 => Ok(None),
        Err(error) => Err(unreachable_server(error)),
    }
}

/// How the examiner of an exam confirmed who the candidate is.
fn identity(check: IdentityCheck) -> &'static str {
    match check {
        IdentityCheck::Badge => "confirmed by a badge with a photo",
        IdentityCheck::Document => "confirmed by an identity document",
        IdentityCheck::Known => "confirmed by the examiner, who knows the person",
    }
}

/// The attempts of an exam: used, allowed, declared void.
fn attempts(exam: &CertifiedExam) -> String {
    let used = format!("{} of {} used", exam.attempts_used, exam.attempts_allowed);
    let voided: Vec<String> = exam.voided.iter().map(u32::to_string).collect();
    match voided.as_slice() {
        [] => used,
        [one] => format!("{used}, attempt {one} declared void"),
        more => format!("{used}, attempts {} declared void", more.join(", ")),
    }
}

/// What a certificate says, one fact on a line.
fn facts(content: &CertificateContent) -> String {
    let CertificateContent { trainee, task, standard, earned_on, issuer, issued_on, centre, address, key, .. } =
        content;
    let centre = centre.as_deref().unwrap_or("(without a name)");
    let result = match &content.exam {
        Some(_) => format!("passed an exam on {earned_on}, version {} of the standard", standard.version),
        None => format!("met the standard on {earned_on}, version {} of the standard", standard.version),
    };
    let mut lines = vec![("Person", trainee.clone()), ("Task", task.clone()), ("Result", result)];
    if let Some(exam) = &content.exam {
        lines.extend([
            ("Exam", format!("held on {} by {}", exam.held_on, exam.examiner)),
            ("Identity", identity(exam.identity).to_owned()),
            ("Attempts", attempts(exam)),
        ]);
    }
    lines.extend(standard.limits.iter().map(|limit| ("Limit", limit.clone())));
    lines.extend([
        ("Centre", centre.to_owned()),
        ("Issued", format!("{issued_on} by {issuer}")),
        ("Address", address.clone()),
        ("Key", key.to_string()),
    ]);
    lines.into_iter().map(|(name, value)| format!("{name:8} {}\n", value.replace(char::is_control, " "))).collect()
}
