//! Who chose an account's password, and whether it must be changed before anything else.

use super::named;

named! {
    /// Who chose an account's password, and who must change it.
    PasswordState: "state of a password" {
        /// There is none yet: the person chooses one with a link.
        Missing = "missing",
        /// The person chose it, or it need not be changed.
        Own = "own",
        /// The program made it at the first start, or a command on the machine set it. A page lets the person do
        /// nothing but change it. Programs can sign in with it, since they set up centres.
        ChangeInBrowser = "change_in_browser",
        /// An administrator chose it: every sign-in with it can do nothing but change it.
        ChangeRequired = "change_required",
    }
}

impl PasswordState {
    /// True if a sign-in can do nothing but change the password. `is_page`: one of the service's pages signs in.
    pub fn must_change(self, is_page: bool) -> bool {
        match self {
            Self::Missing | Self::ChangeRequired => true,
            Self::ChangeInBrowser => is_page,
            Self::Own => false,
        }
    }
}
