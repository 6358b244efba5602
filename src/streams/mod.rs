//! Live streams: who may put frames in, what becomes of them, and who gets them.
//!
//! [`Registry`] has all of them by name. A [`Stream`] is what publishers, readers and
//! operators hold; its task, which nobody holds, does the work. A [`Publication`] is one
//! publisher's hold on a stream, a [`Subscription`] one reader's place in it.
//!
//! Nothing here knows HTTP.

mod events;
mod follow;
mod history;
mod intake;
mod ladder;
mod name;
mod parts;
mod pattern;
mod publication;
mod publisher_slot;
mod registry;
mod relay;
mod relayed;
mod settings;
mod stream;
mod subscription;
mod tape;
mod task;

pub use events::{Figures, FrameEvent, Life, LifeEvent, Listener};
pub use history::{Delivered, HistoryLimits, Loss, Outcome};
pub use intake::{Place, Refused, Submission, Ticket};
pub use name::{InvalidStreamName, StreamName};
pub use pattern::StreamPattern;
pub use publication::Publication;
pub use publisher_slot::{Occupied, Session};
pub use registry::{NotConfigured, Options, Registry};
pub use settings::{Configured, InvalidConfig, POSITION_BITS, StreamRule};
pub use stream::Stream;
pub use subscription::{Delivery, Seat, Subscription};
pub use tape::Tape;
