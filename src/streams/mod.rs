//! Live streams: who may put frames in, what becomes of them, and who gets them.
//!
//! [`Registry`] has all of them by name. A [`Stream`] is what publishers, readers and
//! operators hold; its task, which nobody holds, does the work. A [`Subscription`] is one
//! reader's place in a stream.
//!
//! Nothing here knows HTTP.

mod history;
mod name;
mod registry;
mod settings;
mod stream;
mod subscription;
mod task;

pub use history::{Delivered, Loss, Outcome};
pub use name::{InvalidStreamName, StreamName};
pub use registry::{NotConfigured, Options, Registry};
pub use settings::{Configured, InvalidConfig, POSITION_BITS};
pub use stream::{Place, Refused, Stream, Submission};
pub use subscription::{Delivery, Subscription};
