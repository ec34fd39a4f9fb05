//! Streams of dwells from senders that come and go, hang, and come again.

use std::collections::VecDeque;
use std::io;

use proto::plots::{Damage, Ingest, Scan};
use tokio::io::AsyncReadExt;
use tokio::net::TcpStream;
use tokio::sync::mpsc;
use tokio::task::{AbortHandle, JoinSet};
use tracing::{info, warn};

/// Bytes read at once.
const PIECE_BYTES: usize = 1 << 16;
/// Senders that may be connected at once. One that lost its power leaves a connection that never ends;
/// when there are too many, the oldest is closed.
const MAX_SENDER_COUNT: usize = 8;
/// Pieces that may wait to be sent on; senders are then slowed down.
const WAITING_COUNT: usize = 16;

/// What a stream gave.
pub(super) type Found = Vec<Result<Scan, Damage>>;

/// One connection, and what is known of what it says.
pub(super) struct Intake {
    stream: TcpStream,
    ingest: Ingest,
    buffer: Vec<u8>,
}

impl Intake {
    /// `ingest` may know dates and jobs from an earlier connection.
    pub(super) fn new(stream: TcpStream, ingest: Ingest) -> Self {
        Self { stream, ingest, buffer: vec![0; PIECE_BYTES] }
    }

    /// Reads once; false if the sender has left.
    ///
    /// # Errors
    /// If the connection is broken.
    pub(super) async fn advance(&mut self, into: &mut Found) -> io::Result<bool> {
        let count = self.stream.read(&mut self.buffer).await?;
        self.ingest.feed(&self.buffer[..count], into);
        Ok(0 < count)
    }

    /// Ends the connection; what was told of dates and jobs is kept for the next.
    pub(super) fn end(mut self, into: &mut Found) -> Ingest {
        self.ingest.finish(into);
        self.ingest
    }
}

/// All that are connected.
pub(super) struct Senders {
    readers: JoinSet<Ingest>,
    handles: VecDeque<AbortHandle>,
    heard: mpsc::Sender<io::Result<Found>>,
    spare: Option<Ingest>,
}

impl Senders {
    /// Nobody is connected; what senders say comes out of the receiver.
    pub(super) fn new() -> (Self, mpsc::Receiver<io::Result<Found>>) {
        let (heard, receiver) = mpsc::channel(WAITING_COUNT);
        let (readers, handles) = (JoinSet::new(), VecDeque::new());
        (Self { readers, handles, heard, spare: None }, receiver)
    }

    /// Reads a connection beside the others; what the last one that ended knew is known to it, or else
    /// what `new` knows.
    pub(super) fn add(&mut self, stream: TcpStream, new: impl FnOnce() -> Ingest) {
        while let Some(ended) = self.readers.try_join_next() {
            // Readers that were closed for others have nothing to leave.
            self.spare = ended.ok().or(self.spare.take());
        }
        self.handles.retain(|handle| !handle.is_finished());
        if MAX_SENDER_COUNT <= self.handles.len()
            && let Some(oldest) = self.handles.pop_front()
        {
            warn!(MAX_SENDER_COUNT, "too many senders: the oldest connection is closed");
            oldest.abort();
        }
        let intake = Intake::new(stream, self.spare.take().unwrap_or_else(new));
        self.handles.push_back(self.readers.spawn(read(intake, self.heard.clone())));
    }
}

/// Reads a connection to its end.
async fn read(mut intake: Intake, heard: mpsc::Sender<io::Result<Found>>) -> Ingest {
    let mut found = Vec::new();
    loop {
        let advanced = intake.advance(&mut found).await;
        if !found.is_empty() {
            // Nobody listens only when the agent ends.
            drop(heard.send(Ok(std::mem::take(&mut found))).await);
        }
        match advanced {
            Ok(true) => continue,
            Ok(false) => {}
            Err(failure) => drop(heard.send(Err(failure)).await),
        }
        let ingest = intake.end(&mut found);
        drop(heard.send(Ok(found)).await);
        info!("the sender has left");
        return ingest;
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use proto::plots::{Format, Naming};
    use tokio::io::AsyncWriteExt;
    use tokio::net::TcpListener;

    use super::*;

    const HEAD: &str = "time_s,lat_deg,lon_deg,sensor_lat_deg,sensor_lon_deg,sensor_height_m\n";

    fn new() -> Ingest {
        Ingest::new(Format::Csv, Naming::Fixed("eye".parse().unwrap()))
    }

    /// The times of the next scans that are heard.
    async fn next(heard: &mut mpsc::Receiver<io::Result<Found>>) -> Vec<f64> {
        loop {
            let said = tokio::time::timeout(Duration::from_secs(20), heard.recv()).await;
            let found = said.expect("in time").unwrap().unwrap();
            if !found.is_empty() {
                return found.into_iter().map(|one| one.unwrap().time_s()).collect();
            }
        }
    }

    /// A sender that hangs in the middle of a line keeps nobody from being heard.
    #[tokio::test]
    async fn a_sender_that_hangs_keeps_nobody_out() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let at = listener.local_addr().unwrap();
        let (mut senders, mut heard) = Senders::new();
        let mut hung = Vec::new();
        for number in 0..2 * MAX_SENDER_COUNT {
            let mut stuck = TcpStream::connect(at).await.unwrap();
            senders.add(listener.accept().await.unwrap().0, new);
            stuck.write_all(format!("{HEAD}1,40,110").as_bytes()).await.unwrap();
            hung.push(stuck);
            let mut good = TcpStream::connect(at).await.unwrap();
            senders.add(listener.accept().await.unwrap().0, new);
            good.write_all(format!("{HEAD}{number},40,110,41,110,9000\n").as_bytes())
                .await
                .unwrap();
            drop(good);
            assert_eq!(next(&mut heard).await, [number as f64]);
        }
        assert!(senders.handles.len() <= MAX_SENDER_COUNT);
    }
}
