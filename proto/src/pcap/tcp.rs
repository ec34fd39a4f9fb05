//! The bytes of one direction of a TCP connection in order.

use std::collections::BTreeMap;

use super::frame::Content;

/// Most bytes that wait for missing ones; then the gap is given up.
const MOST_WAITING_BYTES: usize = 1 << 20;

/// Puts the pieces of one direction of one connection in order.
///
/// The caller picks the connection by its two addresses. Repeated and overlapping bytes are used
/// once, pieces that come early wait for at most a megabyte of others. A capture that begins
/// within a connection is joined at the first piece that is given. Not handled: pieces of two
/// connections mixed, and urgent data, which stays in line.
#[derive(Debug, Clone, Default)]
pub struct TcpStream {
    /// Number of the next byte.
    next: Option<u32>,
    /// Pieces that came early, by how far they are ahead of the first byte of all.
    waiting: BTreeMap<u64, Vec<u8>>,
    /// How many bytes were handed out or given up.
    position: u64,
    lost_count: u64,
}

impl TcpStream {
    /// The bytes that are in order with this piece, those after a gap that was given up alone; empty while some before it are missing, and
    /// for what is no TCP.
    pub fn push(&mut self, content: &Content) -> Vec<u8> {
        let Content::Tcp { sequence, starts, bytes } = content else { return Vec::new() };
        let first = sequence.wrapping_add(u32::from(*starts));
        if *starts {
            // A new connection with the same addresses begins anew.
            self.waiting.clear();
            self.next = Some(first);
        }
        let next = *self.next.get_or_insert(first);
        let ahead = i64::from(first.wrapping_sub(next).cast_signed());
        self.keep(ahead, bytes);
        if MOST_WAITING_BYTES < self.waiting.values().map(Vec::len).sum() {
            self.give_up_gap();
        }
        self.take_ready()
    }

    /// Bytes that were missing and given up.
    #[must_use]
    pub fn lost_count(&self) -> u64 {
        self.lost_count
    }

    /// No more pieces will come: gives up the next gap and returns what lies between it and the one
    /// after; `None` if nothing is left.
    pub fn give_up(&mut self) -> Option<Vec<u8>> {
        if self.waiting.is_empty() {
            return None;
        }
        self.give_up_gap();
        Some(self.take_ready())
    }

    /// Says that no more pieces will come: gives up every gap and returns what is left.
    pub fn finish(&mut self) -> Vec<u8> {
        std::iter::from_fn(|| self.give_up()).flatten().collect()
    }

    /// Keeps what of a piece was not handed out; of two pieces at one place the longer.
    fn keep(&mut self, ahead: i64, bytes: &[u8]) {
        let (skipped, ahead) = if ahead < 0 { (ahead.unsigned_abs(), 0) } else { (0, ahead) };
        let skipped = usize::try_from(skipped).unwrap_or(usize::MAX);
        let Some(bytes) = bytes.get(skipped..).filter(|bytes| !bytes.is_empty()) else { return };
        let piece = self.waiting.entry(self.position + ahead.unsigned_abs()).or_default();
        if piece.len() < bytes.len() {
            *piece = bytes.to_vec();
        }
    }

    fn give_up_gap(&mut self) {
        if let Some((&first, _)) = self.waiting.first_key_value() {
            let gap = first.saturating_sub(self.position);
            self.lost_count += gap;
            self.move_on(gap);
        }
    }

    fn take_ready(&mut self) -> Vec<u8> {
        let mut ready = Vec::new();
        while let Some(entry) = self.waiting.first_entry() {
            let Some(used) = self.position.checked_sub(*entry.key()) else { break };
            let piece = entry.remove();
            let used = usize::try_from(used).unwrap_or(usize::MAX);
            let fresh = piece.get(used..).unwrap_or_default();
            ready.extend_from_slice(fresh);
            self.move_on(fresh.len() as u64);
        }
        ready
    }

    #[expect(clippy::cast_possible_truncation, reason = "numbers of bytes count modulo 2^32")]
    fn move_on(&mut self, count: u64) {
        self.position += count;
        self.next = self.next.map(|next| next.wrapping_add(count as u32));
    }
}
