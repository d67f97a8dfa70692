//! `trocar admin user`: accounts, such as that of the first administrator, and new passwords for forgotten ones.

use std::io::BufRead;

use anyhow::Context;
use clap::Subcommand;

use super::super::CommandFailure;
use super::{DataFolder, store_failure};
use crate::domain::password_state::PasswordState;
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::secret::{Password, PasswordHash, Secret};
use crate::domain::text::{Key, Login, Name};
use crate::store::{NewPerson, PageRequest, PersonRecord, StoreError};

/// Subcommands of `trocar admin user`.
#[derive(Subcommand)]
pub enum UserCommand {
    /// List the accounts: login, role, name.
    List,
    /// Create an account; prints its password unless --password-stdin is given. The person changes it when they first
    /// sign in with a browser.
    Add {
        /// Login name, typed to sign in
        login: Login,
        /// administrator, instructor or trainee
        #[arg(long)]
        role: Role,
        /// Name of the person [default: the login]
        #[arg(long)]
        name: Option<Name>,
        /// With --role trainee: id or code of the trainee that the account belongs to
        #[arg(long)]
        trainee: Option<String>,
        /// Read the password from the first line of standard input
        #[arg(long)]
        password_stdin: bool,
    },
    /// Set a password, sign the account out everywhere and withdraw its tokens; prints the password unless
    /// --password-stdin is given. The person changes it when they next sign in with a browser.
    Password {
        /// Login name of the account
        login: Login,
        /// Keep the tokens that act as this account
        #[arg(long)]
        keep_tokens: bool,
        /// Read the password from the first line of standard input
        #[arg(long)]
        password_stdin: bool,
    },
    /// Make a link for choosing a password, valid once, for 24 hours unless the settings say otherwise; prints the part
    /// that follows the address of the service. It works while guesses of others make the account wait, and lets the
    /// browser that uses it sign in.
    Link {
        /// Login name of the account
        login: Login,
    },
    /// Delete an account; its person can no longer sign in.
    Delete {
        /// Login name of the account
        login: Login,
    },
}

/// Runs the command.
pub async fn run(folder: &DataFolder, command: UserCommand) -> Result<(), CommandFailure> {
    match command {
        UserCommand::List => list_accounts(folder).await,
        UserCommand::Add { login, role, name, trainee, password_stdin } => {
            let trainee = match trainee {
                Some(key) => {
                    let trainees = folder.store.trainees();
                    Some(trainees.get(&Scope::service(), &Key::from(&key)).await.map_err(store_failure)?.id)
                }
                None => None,
            };
            let (password, hash) = choose_password(password_stdin).await?;
            let name = name.map_or_else(|| login.as_str().parse(), Ok).map_err(CommandFailure::input)?;
            let password_state = PasswordState::ChangeInBrowser;
            let new = NewPerson { login, name, role, password: hash, password_state, trainee };
            folder.store.people().create(&Scope::service(), new).await.map_err(store_failure)?;
            print_password(password);
            Ok(())
        }
        UserCommand::Password { login, keep_tokens, password_stdin } => {
            let person = find_account(folder, &login).await?;
            let (password, hash) = choose_password(password_stdin).await?;
            let (people, new) = (folder.store.people(), (hash, PasswordState::ChangeInBrowser));
            people.set_password(&Scope::service(), person.id, new, keep_tokens).await.map_err(store_failure)?;
            print_password(password);
            Ok(())
        }
        UserCommand::Link { login } => {
            let (person, secret) = (find_account(folder, &login).await?, Secret::random());
            let (links, service) = (folder.store.password_links(), Scope::service());
            links.create(&service, person.id, secret.hash(), folder.password_link).await.map_err(store_failure)?;
            println!("/choose-password#{}", secret.as_cookie());
            Ok(())
        }
        UserCommand::Delete { login } => {
            let person = find_account(folder, &login).await?;
            folder.store.people().delete(&Scope::service(), person.id).await.map_err(store_failure)
        }
    }
}

async fn list_accounts(folder: &DataFolder) -> Result<(), CommandFailure> {
    let mut after = None;
    loop {
        let page = PageRequest::new(PageRequest::MAX_LIMIT, after);
        let page = folder.store.people().list(&Scope::service(), &page).await.map_err(store_failure)?;
        for PersonRecord { login, role, name, .. } in &page.items {
            println!("{login}\t{role}\t{name}");
        }
        after = page.next;
        if after.is_none() {
            return Ok(());
        }
    }
}

/// The account with this login.
pub(super) async fn find_account(folder: &DataFolder, login: &Login) -> Result<PersonRecord, CommandFailure> {
    let found = folder.store.people().by_login(login).await.map_err(store_failure)?;
    found.map(|(person, _)| person).ok_or_else(|| store_failure(StoreError::NotFound { what: "account" }))
}

/// Reads the password from standard input, or makes a random one. Returns the hash and, if it is random, the password
/// to print.
async fn choose_password(from_stdin: bool) -> Result<(Option<Password>, PasswordHash), CommandFailure> {
    if !from_stdin {
        let password = Password::random();
        let hash = password.hash();
        return Ok((Some(password), hash));
    }
    let mut line = String::new();
    std::io::stdin().lock().read_line(&mut line).context("reading the password from standard input")?;
    let password = Password::new(line.trim_end_matches(['\r', '\n'])).map_err(CommandFailure::input)?;
    Ok((None, password.hash()))
}

fn print_password(password: Option<Password>) {
    if let Some(password) = password {
        println!("{}", password.reveal());
    }
}
