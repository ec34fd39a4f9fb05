//! One `encode`, one `decode`: nobody else in the project names a codec.

use bincode::config::{Configuration, Fixint, Limit, LittleEndian};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::check::Invalid;
use super::header::{Header, Kind, Refusal, open, seal};
use crate::ids::BootId;

/// No payload of any kind is larger; the decoder refuses to allocate more.
pub const MAX_PAYLOAD_BYTES: usize = 1 << 20;

type Layout = Configuration<LittleEndian, Fixint, Limit<MAX_PAYLOAD_BYTES>>;

fn layout() -> Layout {
    bincode::config::standard().with_fixed_int_encoding().with_limit::<MAX_PAYLOAD_BYTES>()
}

/// Something that can be sent.
pub trait Message: Serialize + DeserializeOwned {
    /// What the header calls it.
    const KIND: Kind;
    /// Version of the payload's layout: counts up with every change of a field.
    const SCHEMA: u16;
    /// Most payload bytes that are read.
    const MAX_BYTES: usize;

    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    fn check(&self) -> Result<(), Invalid>;
}

/// Who sends, which one of its messages this is, and when it left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamp {
    /// The sender's life.
    pub boot: BootId,
    /// Counts the sender's messages of this kind, from zero, without gaps.
    pub sequence: u64,
    /// The sender's monotonic clock, nanoseconds.
    pub sent_ns: u64,
}

/// A message as it arrived.
#[derive(Clone, Debug, PartialEq)]
pub struct Received<M> {
    /// From the header.
    pub stamp: Stamp,
    /// The checked message.
    pub body: M,
}

/// The bytes of `message`.
///
/// # Errors
/// If a field makes no sense or the message is larger than its kind may be: what would be refused
/// on arrival is refused here.
pub fn encode<M: Message>(stamp: Stamp, message: &M) -> Result<Vec<u8>, Refusal> {
    message.check()?;
    let payload = bincode::serde::encode_to_vec(message, layout())
        .map_err(|error| Refusal::Payload { kind: M::KIND, detail: error.to_string() })?;
    if M::MAX_BYTES < payload.len() {
        let got = payload.len();
        return Err(Refusal::Oversized { kind: M::KIND, got, limit: M::MAX_BYTES });
    }
    let Stamp { boot, sequence, sent_ns } = stamp;
    Ok(seal(&Header { kind: M::KIND, schema: M::SCHEMA, boot, sequence, sent_ns }, &payload))
}

/// The message in `bytes`.
///
/// # Errors
/// If anything at all is not as [`encode`] would have written it.
pub fn decode<M: Message>(bytes: &[u8]) -> Result<Received<M>, Refusal> {
    let (header, payload) = open(bytes, M::KIND, M::SCHEMA, M::MAX_BYTES)?;
    let (body, used): (M, usize) = bincode::serde::decode_from_slice(payload, layout())
        .map_err(|error| Refusal::Payload { kind: M::KIND, detail: error.to_string() })?;
    if used != payload.len() {
        return Err(Refusal::Trailing { kind: M::KIND, left: payload.len() - used });
    }
    body.check()?;
    let Header { boot, sequence, sent_ns, .. } = header;
    Ok(Received { stamp: Stamp { boot, sequence, sent_ns }, body })
}
