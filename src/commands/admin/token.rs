//! `trocar admin token`: access tokens of programs.

use clap::Subcommand;

use super::super::CommandFailure;
use super::{DataFolder, store_failure, user};
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::secret::Secret;
use crate::domain::text::{Invalid, Key, Login, Name};
use crate::domain::token_expiry::TokenExpiry;
use crate::ids::TokenId;
use crate::store::{ActsAs, NewToken, TokenRecord};
use crate::time::{self, Clock, SystemClock};

/// Subcommands of `trocar admin token`.
#[derive(Subcommand)]
pub enum TokenCommand {
    /// List the tokens: id, role, name, expiry.
    List,
    /// Create a token and print it; it cannot be shown again.
    Add {
        /// Name of the token: the purpose it serves
        name: Name,
        /// Account whose rights the token has; needed unless --box is given
        #[arg(long, value_name = "LOGIN", required_unless_present = "for_box")]
        acts_for: Option<Login>,
        /// Role of the token, if lower than the account's: administrator, instructor or trainee
        #[arg(long, requires = "acts_for")]
        role: Option<Role>,
        /// Id or code of the box, for the token of a box's agent
        #[arg(long = "box", value_name = "BOX", conflicts_with = "acts_for")]
        for_box: Option<String>,
        /// When the token expires, within ten years, such as 2027-01-31T00:00:00Z, or `never` [default: in a year]
        #[arg(long, value_name = "TIME", value_parser = parse_expiry)]
        expires_at: Option<TokenExpiry>,
    },
    /// Delete a token; programs that use it lose access.
    Delete {
        /// Id of the token
        id: TokenId,
    },
}

/// Runs the command.
pub async fn run(folder: &DataFolder, command: TokenCommand) -> Result<(), CommandFailure> {
    let (service, tokens) = (Scope::service(), folder.store.tokens());
    match command {
        TokenCommand::List => {
            for TokenRecord { id, role, name, expires_at_ms, .. } in
                tokens.list(&service).await.map_err(store_failure)?
            {
                let end = expires_at_ms.map_or_else(|| "never expires".to_owned(), time::to_rfc3339);
                println!("{id}\t{role}\t{name}\t{end}");
            }
        }
        TokenCommand::Add { name, acts_for, role, for_box, expires_at } => {
            let acts_as = acts_as(folder, acts_for, role, for_box).await?;
            let secret = Secret::random();
            let expires_at_ms =
                TokenExpiry::end_ms(expires_at, None, SystemClock.now_ms()).map_err(CommandFailure::input)?;
            let new = NewToken { name, acts_as, expires_at_ms, secret: secret.hash() };
            tokens.create(&service, new).await.map_err(store_failure)?;
            println!("{}", secret.as_token());
        }
        TokenCommand::Delete { id } => tokens.delete(&service, id).await.map_err(store_failure)?,
    }
    Ok(())
}

async fn acts_as(
    folder: &DataFolder,
    acts_for: Option<Login>,
    role: Option<Role>,
    for_box: Option<String>,
) -> Result<ActsAs, CommandFailure> {
    if let Some(login) = acts_for {
        let person = user::find_account(folder, &login).await?;
        return Ok(ActsAs::Person(person.id, role.unwrap_or(person.role)));
    }
    let key = Key::from(&for_box.unwrap_or_default()); // the command line requires one of the two
    let found = folder.store.boxes().get(&Scope::service(), &key).await.map_err(store_failure)?;
    Ok(ActsAs::Agent(found.id))
}

fn parse_expiry(text: &str) -> Result<TokenExpiry, Invalid> {
    text.parse()
}
