//! Where a page is: the address of its server, and its token.

use std::fs;
use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use files::InputError;

/// The address that a server shall listen at. Port 0 is any free port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Address(pub(super) SocketAddr);

/// The address of a server on any free port of this computer alone.
pub(crate) const THIS_COMPUTER: &str = "127.0.0.1:0";

impl FromStr for Address {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parsed = match text.parse::<u16>() {
            Ok(port) => Ok(SocketAddr::from(([127, 0, 0, 1], port))),
            Err(_) => text.replace("localhost:", "127.0.0.1:").parse(),
        };
        parsed.map(Address).map_err(|_| {
            "expected a port or an address of this computer with one, such as 8000, 127.0.0.1:8000 \
             or 0.0.0.0:8000 for other computers too; the data set comes before --serve"
                .to_owned()
        })
    }
}

impl Address {
    /// Checks that a server can listen at it.
    ///
    /// # Errors
    /// If it cannot.
    pub(crate) fn check(self) -> Result<(), InputError> {
        self.listen(None).map(drop)
    }

    /// Listens, at the address `before` if that is one of these and free.
    pub(super) fn listen(self, before: Option<SocketAddr>) -> Result<TcpListener, InputError> {
        let Address(wanted) = self;
        if let Some(before) = before.filter(|b| wanted.port() == 0 && b.ip() == wanted.ip())
            && let Ok(listener) = TcpListener::bind(before)
        {
            return Ok(listener);
        }
        TcpListener::bind(wanted).map_err(|error| {
            refused(format!("{wanted} ({error})"), "an address of this computer with a free port")
        })
    }
}

/// Where the page of a run is: the file `serve.json` of its folder, for its owner alone.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Known {
    pub(super) address: SocketAddr,
    pub(super) token: String,
}

impl Known {
    const FILE: &str = "serve.json";

    /// That of the run in `folder`; `None` without the file, with one that cannot be read, and with
    /// one that others could read, too.
    pub(crate) fn load(folder: &Path) -> Option<Self> {
        let path = folder.join(Self::FILE);
        let metadata =
            fs::symlink_metadata(&path).ok().filter(|m| m.is_file() && m.len() < 1000)?;
        #[cfg(unix)]
        if std::os::unix::fs::MetadataExt::mode(&metadata) & 0o077 != 0 {
            return None;
        }
        let known: Known = serde_json::from_slice(&fs::read(&path).ok()?).ok()?;
        let is_token = known.token.len() == 2 * TOKEN_BYTES
            && known.token.bytes().all(|byte| byte.is_ascii_hexdigit());
        is_token.then_some(known)
    }

    /// Writes the file.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn save(&self, folder: &Path) -> anyhow::Result<()> {
        let text = serde_json::to_string(self)?;
        files::atomic_write_private(&folder.join(Self::FILE), |out| {
            out.write_all(text.as_bytes())
        })?;
        Ok(())
    }

    /// The address of the page, and what to say about it.
    pub(super) fn url(&self) -> String {
        let Known { address, token } = self;
        if !address.ip().is_unspecified() {
            return format!("http://{address}/?token={token}");
        }
        let port = address.port();
        format!(
            "http://127.0.0.1:{port}/?token={token} (on other computers: with this one's address; \
             nothing is encrypted)"
        )
    }
}

/// The bytes of a token.
const TOKEN_BYTES: usize = 16;

/// A token that nobody can guess, as hexadecimal digits.
///
/// # Errors
/// If the system gives no random numbers.
pub(super) fn new_token() -> anyhow::Result<String> {
    let mut bytes = [0_u8; TOKEN_BYTES];
    getrandom::fill(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// The error of an address that cannot be used.
fn refused(found: impl std::fmt::Display, expected: &str) -> InputError {
    InputError::new(files::ARGUMENTS, "--serve", found, expected)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_a_port_or_an_address_with_one() {
        let parsed = |text: &str| text.parse::<Address>().map(|address| address.0.to_string());
        assert_eq!(parsed("8000").unwrap(), "127.0.0.1:8000");
        assert_eq!(parsed("localhost:80").unwrap(), "127.0.0.1:80");
        assert_eq!(parsed("[::1]:80").unwrap(), "[::1]:80");
        for wrong in ["data", "127.0.0.1", "70000", "example.org:80", ""] {
            assert!(parsed(wrong).unwrap_err().contains("such as 8000"), "{wrong}");
        }
    }

    #[test]
    fn a_later_server_of_a_run_has_its_address_and_its_token() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(Known::load(folder.path()), None);
        let address = Address("127.0.0.1:0".parse().unwrap());
        let listener = address.listen(None).unwrap();
        let known = Known { address: listener.local_addr().unwrap(), token: new_token().unwrap() };
        known.save(folder.path()).unwrap();
        assert_eq!(Known::load(folder.path()).as_ref(), Some(&known));
        // Another port while the first server lives.
        let other = address.listen(Some(known.address)).unwrap().local_addr().unwrap();
        assert_ne!(other, known.address);
        drop(listener);
        let again = address.listen(Some(known.address)).unwrap().local_addr().unwrap();
        assert_eq!(again, known.address);
        let shown = |address: &str| {
            Known { address: address.parse().unwrap(), token: "t".to_owned() }.url()
        };
        assert_eq!(shown("127.0.0.1:80"), "http://127.0.0.1:80/?token=t");
        assert!(shown("0.0.0.0:80").starts_with("http://127.0.0.1:80/?token=t (on other"));
        // A file that others can read, and a link, are replaced and not believed.
        #[cfg(unix)]
        {
            let (file, victim) = (folder.path().join(Known::FILE), folder.path().join("victim"));
            let open = std::os::unix::fs::PermissionsExt::from_mode(0o644);
            fs::set_permissions(&file, open).unwrap();
            assert_eq!(Known::load(folder.path()), None);
            fs::rename(&file, &victim).unwrap();
            let before = fs::read(&victim).unwrap();
            std::os::unix::fs::symlink(&victim, &file).unwrap();
            assert_eq!(Known::load(folder.path()), None);
            Known { token: new_token().unwrap(), ..known }.save(folder.path()).unwrap();
            assert_eq!(fs::read(&victim).unwrap(), before);
            assert!(Known::load(folder.path()).is_some());
        }
        for broken in ["{", r#"{"address":"127.0.0.1:1","token":"short"}"#] {
            fs::write(folder.path().join(Known::FILE), broken).unwrap();
            assert_eq!(Known::load(folder.path()), None);
        }
    }
}
