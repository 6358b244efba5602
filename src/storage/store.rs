//! The object store that an address means.

use std::path::PathBuf;
use std::sync::Arc;

use object_store::local::LocalFileSystem;
use object_store::path::Path;
use object_store::{ObjectStore, parse_url_opts};
use url::Url;

use super::UnusableStore;

/// A store, and where in it recordings begin.
#[derive(Debug, Clone)]
pub(super) struct Store {
    pub objects: Arc<dyn ObjectStore>,
    pub root: Path,
    /// The folder, if it is one.
    pub folder: Option<PathBuf>,
}

/// What a store is opened for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Purpose {
    Read,
    Write,
}

/// Opens the store. A folder to be written is made if it is not there, and written with `fsync`: what has been
/// stored survives a power cut. What other stores need to know (keys, region, endpoint) comes from
/// the environment variables that `object_store` documents, such as `AWS_ACCESS_KEY_ID`.
///
/// # Errors
///
/// [`UnusableStore`].
pub(super) fn open(url: &Url, purpose: Purpose) -> Result<Store, UnusableStore> {
    let cannot = |reason: String| {
        let mut shown = url.clone();
        // Fails for addresses that have none.
        shown.set_password(None).ok();
        UnusableStore::Url {
            url: shown.to_string(),
            reason,
        }
    };
    if url.scheme() == "file" {
        let folder = url
            .to_file_path()
            .map_err(|()| cannot("it is not a path of this machine".to_owned()))?;
        return open_folder(folder, purpose);
    }
    // Only what belongs to a store: the others are not its business.
    let environment = std::env::vars().filter(|(name, _)| {
        ["AWS_", "GOOGLE_", "AZURE_"]
            .iter()
            .any(|prefix| name.starts_with(prefix))
    });
    let options = environment.map(|(name, value)| (name.to_ascii_lowercase(), value));
    let (objects, root) =
        parse_url_opts(url, options).map_err(|error| cannot(error.to_string()))?;
    Ok(Store {
        objects: Arc::from(objects),
        root,
        folder: None,
    })
}

fn open_folder(folder: PathBuf, purpose: Purpose) -> Result<Store, UnusableStore> {
    let cannot = |reason: std::io::Error| UnusableStore::Folder {
        folder: folder.display().to_string(),
        reason,
    };
    if purpose == Purpose::Write {
        std::fs::create_dir_all(&folder).map_err(cannot)?;
        // Found out now rather than when the first frame is lost.
        let probe = folder.join(".steadymesh-writes-here");
        std::fs::write(&probe, b"").map_err(cannot)?;
        std::fs::remove_file(&probe).map_err(cannot)?;
    }
    let local = LocalFileSystem::new_with_prefix(&folder)
        .map_err(|error| cannot(std::io::Error::other(error)))?
        .with_fsync(true)
        .with_automatic_cleanup(true);
    Ok(Store {
        objects: Arc::new(local),
        root: Path::default(),
        folder: Some(folder),
    })
}
