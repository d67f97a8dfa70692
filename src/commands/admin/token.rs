//! `trocar admin token`: ways in for programs.

use clap::Subcommand;

use super::super::Failure;
use super::{Centre, refused, user};
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::secret::Secret;
use crate::domain::text::{Key, Login, Name};
use crate::ids::TokenId;
use crate::store::{ActsAs, NewToken, Token};
use crate::time;

/// What to do with tokens.
#[derive(Subcommand)]
pub enum Command {
    /// List the tokens: id, role, name, end.
    List,
    /// Make a token and print it; it cannot be shown again.
    Add {
        /// What it is for
        name: Name,
        /// The account that it acts for
        #[arg(long, value_name = "LOGIN", required_unless_present = "for_box")]
        acts_for: Option<Login>,
        /// Its role, if less than the account's
        #[arg(long, requires = "acts_for")]
        role: Option<Role>,
        /// The box that an agent feeds, by id or code
        #[arg(long = "box", value_name = "BOX", conflicts_with = "acts_for")]
        for_box: Option<String>,
        /// Its end, such as 2027-01-31T00:00:00Z [default: none]
        #[arg(long, value_parser = parse_time)]
        expires_at: Option<i64>,
    },
    /// Withdraw a token.
    Delete {
        /// Which
        id: TokenId,
    },
}

/// Runs the command.
pub async fn run(centre: &Centre, command: Command) -> Result<(), Failure> {
    let (service, tokens) = (Scope::service(), centre.store.tokens());
    match command {
        Command::List => {
            for Token { id, role, name, expires_at_ms, .. } in tokens.list(&service).await.map_err(refused)? {
                let end = expires_at_ms.map_or_else(|| "no end".to_owned(), time::to_rfc3339);
                println!("{id}\t{role}\t{name}\t{end}");
            }
        }
        Command::Add { name, acts_for, role, for_box, expires_at } => {
            let acts_as = acts_as(centre, acts_for, role, for_box).await?;
            let secret = Secret::random();
            let new = NewToken { name, acts_as, expires_at_ms: expires_at, secret: secret.hash() };
            tokens.create(&service, new).await.map_err(refused)?;
            println!("{}", secret.as_token());
        }
        Command::Delete { id } => tokens.delete(&service, id).await.map_err(refused)?,
    }
    Ok(())
}

async fn acts_as(
    centre: &Centre,
    acts_for: Option<Login>,
    role: Option<Role>,
    for_box: Option<String>,
) -> Result<ActsAs, Failure> {
    if let Some(login) = acts_for {
        let person = user::find(centre, &login).await?;
        return Ok(ActsAs::Person(person.id, role.unwrap_or(person.role)));
    }
    let key = Key::from(&for_box.unwrap_or_default()); // the command line requires one of the two
    let found = centre.store.boxes().get(&Scope::service(), &key).await.map_err(refused)?;
    Ok(ActsAs::Agent(found.id))
}

fn parse_time(text: &str) -> Result<i64, String> {
    time::from_rfc3339(text).ok_or_else(|| "expected a time such as 2027-01-31T00:00:00Z".to_owned())
}
