//! Where `publish` has its frames from.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use anyhow::Context;
use bytes::Bytes;
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use steadymesh_mesh_io::Format;
use steadymesh_proto::wording::counted;
use steadymesh_proto::{Bundle, NativeFrame};
use steadymesh_synthetic_rig::{Options, Rig};

use super::frame_files::{expand, format_of};
use super::images;
use super::progress::progress_bar;
use crate::stopwatch::microseconds;

/// One take of frames, each ready to be sent any number of times.
#[derive(Debug)]
pub(super) enum FrameSource {
    /// Files, which are read when their turn comes.
    Files(Vec<PathBuf>),
    /// Native frames in memory.
    Synthetic(Vec<Bytes>),
}

/// A frame to be sent.
#[derive(Debug, Clone)]
pub(super) struct SourceFrame {
    /// What to call it when something is wrong with it.
    pub name: String,
    pub content_type: Cow<'static, str>,
    pub body: Bytes,
    /// Of a frame that was recorded: others are numbered and captured as they are sent.
    pub recorded: Option<Recorded>,
}

/// What a recorded frame said of itself.
#[derive(Debug, Clone, Copy)]
pub(super) struct Recorded {
    pub seq: u64,
    pub capture_time_us: Option<u64>,
}

impl SourceFrame {
    /// When it was captured, in microseconds since 1970: now, unless it was recorded.
    ///
    /// # Errors
    ///
    /// If it is not 1970 yet.
    pub fn capture_time_us(&self) -> anyhow::Result<Option<u64>> {
        if let Some(recorded) = self.recorded {
            return Ok(recorded.capture_time_us);
        }
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH)?;
        Ok(Some(microseconds(now)))
    }
}

impl FrameSource {
    /// The frames in files and folders.
    ///
    /// # Errors
    ///
    /// A path that does not exist, or a folder without frame files.
    pub fn files(paths: &[PathBuf]) -> anyhow::Result<Self> {
        Ok(Self::Files(expand(paths)?))
    }

    /// One period of the synthetic rig's motion. All of it is computed now, so that the machine
    /// is free for the server while frames are sent.
    ///
    /// # Errors
    ///
    /// If the rig cannot be had with these options.
    pub fn synthetic(options: &Options) -> anyhow::Result<Self> {
        let rig = Rig::new(options)?;
        super::say(&format!(
            "computing {} of about {} vertices, then sending begins",
            counted(rig.period_frames(), "synthetic frame"),
            options.vertex_count
        ));
        let progress = progress_bar(rig.period_frames());
        let frames = (0..rig.period_frames()).into_par_iter().map(|index| {
            let frame = rig.frame(index);
            let native = NativeFrame {
                positions: frame.positions,
                faces: frame.faces,
                ..NativeFrame::default()
            };
            progress.inc(1);
            Bytes::from(native.encode())
        });
        let frames = frames.collect();
        progress.finish_and_clear();
        Ok(Self::Synthetic(frames))
    }

    /// How many frames the take has.
    pub fn len(&self) -> usize {
        match self {
            Self::Files(files) => files.len(),
            Self::Synthetic(frames) => frames.len(),
        }
    }

    /// Frame `index` of the take.
    ///
    /// # Errors
    ///
    /// A file that cannot be read.
    pub async fn frame(&self, index: usize) -> anyhow::Result<SourceFrame> {
        match self {
            Self::Files(files) => {
                let path = &files[index];
                let name = path.display().to_string();
                let body = tokio::fs::read(path).await;
                let body = body.with_context(|| format!("{name} cannot be read"))?;
                let (format, body) = with_image(path, body)?;
                Ok(SourceFrame {
                    name,
                    content_type: format.content_type().into(),
                    body: body.into(),
                    recorded: None,
                })
            }
            Self::Synthetic(frames) => Ok(SourceFrame {
                name: format!("synthetic frame {index}"),
                content_type: Format::Native.content_type().into(),
                body: frames[index].clone(),
                recorded: None,
            }),
        }
    }
}

/// A frame file as it is sent: in a bundle with the image beside it, if there is one.
fn with_image(path: &Path, mesh: Vec<u8>) -> anyhow::Result<(Format, Vec<u8>)> {
    let format = format_of(path, &mesh)?;
    let Some(image) = images::beside(path, format, &mesh) else {
        return Ok((format, mesh));
    };
    let bundle = Bundle {
        seq: None,
        capture_time_us: None,
        mesh: &mesh,
        image: &image,
    };
    Ok((Format::Bundle, bundle.encode()))
}
