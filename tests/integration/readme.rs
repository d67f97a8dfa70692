//! The README's transcript works as printed, against the real service.

use std::process::Command;

use crate::process::Process;

#[test]
fn the_transcript_of_the_readme_works_as_printed() {
    if Command::new("curl").arg("--version").output().is_err() || Command::new("jq").arg("--version").output().is_err()
    {
        crate::resources::skip("curl or jq; `make test` installs them");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let service = Process::start(&folder.path().join("data"));
    let script = transcript().replace("127.0.0.1:8080", &service.address);
    let ran = Command::new("bash")
        .args(["-euo", "pipefail", "-c", &script])
        .env("PATH", path())
        .env("PASSWORD", service.password.as_deref().unwrap())
        .current_dir(folder.path())
        .output()
        .unwrap();
    let (out, errors) = (String::from_utf8_lossy(&ran.stdout), String::from_utf8_lossy(&ran.stderr));
    assert!(ran.status.success(), "{errors}\n{out}");
    assert!(out.lines().any(|line| line == "valid"), "the session's verdict is valid:\n{out}");
    let path_length: Vec<_> = out.lines().filter_map(|line| line.strip_prefix("path_length\torange\t3d\t")).collect();
    let [path_length] = path_length[..] else { panic!("one 3-D path length of the orange tool:\n{out}") };
    assert!(path_length.split('\t').next().unwrap().parse::<f64>().is_ok_and(|mm| mm > 0.0), "{path_length}");
    let rows = std::fs::read_to_string(folder.path().join("path.csv")).unwrap();
    assert!(rows.starts_with("frame,time_s,tool,x_mm,y_mm,z_mm,"), "{rows:.200}");
    assert!(rows.lines().count() > 200, "150 frames of two tools");
}

/// The first shell block after the marker.
fn transcript() -> String {
    let readme = include_str!("../../README.md");
    let marked = readme.split("<!-- transcript -->").nth(1).expect("the README has a transcript");
    let block = marked.split("```sh").nth(1).expect("it is a shell block");
    block.split("```").next().unwrap_or_default().to_owned()
}

/// `PATH` with the folder of the built program first.
fn path() -> String {
    let program = std::path::Path::new(env!("CARGO_BIN_EXE_trocar")).parent().unwrap().display();
    format!("{program}:{}", std::env::var_os("PATH").unwrap_or_default().display())
}
