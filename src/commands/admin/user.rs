//! `trocar admin user`: accounts, for the first administrator and for whoever forgot the password.

use std::io::BufRead;

use anyhow::Context;
use clap::Subcommand;

use super::super::Failure;
use super::{Centre, refused};
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::secret::{Password, PasswordHash};
use crate::domain::text::{Key, Login, Name};
use crate::store::{NewPerson, PageRequest, Person, StoreError};

/// What to do with accounts.
#[derive(Subcommand)]
pub enum Command {
    /// List the accounts: login, role, name.
    List,
    /// Make an account; prints its password unless --password-stdin is given.
    Add {
        /// What they type to sign in
        login: Login,
        /// administrator, instructor or trainee
        #[arg(long)]
        role: Role,
        /// What people call them [default: the login]
        #[arg(long)]
        name: Option<Name>,
        /// The trainee that the account is of, by id or code; for --role trainee
        #[arg(long)]
        trainee: Option<String>,
        /// Read the password from the first line of standard input
        #[arg(long)]
        password_stdin: bool,
    },
    /// Set a password and sign the account out everywhere; prints the password unless --password-stdin is given.
    Password {
        /// Whose
        login: Login,
        /// Read the password from the first line of standard input
        #[arg(long)]
        password_stdin: bool,
    },
    /// Shut somebody out.
    Delete {
        /// Whom
        login: Login,
    },
}

/// Runs the command.
pub async fn run(centre: &Centre, command: Command) -> Result<(), Failure> {
    match command {
        Command::List => list(centre).await,
        Command::Add { login, role, name, trainee, password_stdin } => {
            let trainee = match trainee {
                Some(key) => {
                    let trainees = centre.store.trainees();
                    Some(trainees.get(&Scope::service(), &Key::from(&key)).await.map_err(refused)?.id)
                }
                None => None,
            };
            let (password, hash) = choose_password(password_stdin).await?;
            let name = name.map_or_else(|| login.as_str().parse(), Ok).map_err(Failure::input)?;
            let new = NewPerson { login, name, role, password: hash, trainee };
            centre.store.people().create(&Scope::service(), new).await.map_err(refused)?;
            print_password(password);
            Ok(())
        }
        Command::Password { login, password_stdin } => {
            let person = find(centre, &login).await?;
            let (password, hash) = choose_password(password_stdin).await?;
            centre.store.people().set_password(&Scope::service(), person.id, hash).await.map_err(refused)?;
            print_password(password);
            Ok(())
        }
        Command::Delete { login } => {
            let person = find(centre, &login).await?;
            centre.store.people().delete(&Scope::service(), person.id).await.map_err(refused)
        }
    }
}

async fn list(centre: &Centre) -> Result<(), Failure> {
    let mut after = None;
    loop {
        let page = PageRequest::new(PageRequest::MOST, after);
        let page = centre.store.people().list(&Scope::service(), &page).await.map_err(refused)?;
        for Person { login, role, name, .. } in &page.items {
            println!("{login}\t{role}\t{name}");
        }
        after = page.next;
        if after.is_none() {
            return Ok(());
        }
    }
}

/// The account of this login.
pub(super) async fn find(centre: &Centre, login: &Login) -> Result<Person, Failure> {
    let found = centre.store.people().by_login(login).await.map_err(refused)?;
    found.map(|(person, _)| person).ok_or_else(|| refused(StoreError::NotFound { what: "account" }))
}

/// The password on standard input, or a random one to be shown; and its hash.
async fn choose_password(from_stdin: bool) -> Result<(Option<Password>, PasswordHash), Failure> {
    if !from_stdin {
        let password = Password::random();
        let hash = password.hash();
        return Ok((Some(password), hash));
    }
    let mut line = String::new();
    std::io::stdin().lock().read_line(&mut line).context("reading the password from standard input")?;
    let password = Password::new(line.trim_end_matches(['\r', '\n'])).map_err(Failure::input)?;
    Ok((None, password.hash()))
}

fn print_password(password: Option<Password>) {
    if let Some(password) = password {
        println!("{}", password.reveal());
    }
}
