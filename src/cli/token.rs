//! `steadymesh token`: a new token and its hash.

use anyhow::Context;

use crate::server::auth::TokenHash;

/// Runs the command: the token goes to standard output, what to do with it to standard error.
pub(super) fn run() -> anyhow::Result<()> {
    let mut random = [0_u8; 32];
    getrandom::fill(&mut random).context("the system has no random numbers to give")?;
    let token: String = random.iter().map(|byte| format!("{byte:02x}")).collect();
    super::print(&format!("{token}\n"))?;
    super::say(&format!(
        "Give the token above to whoever is to use it, and its hash to the server:\n\n\
         [[auth.tokens]]\nname = \"\"\nhash = \"{}\"\nscopes = [\"publish\", \"subscribe\"]",
        TokenHash::of(&token)
    ));
    Ok(())
}
