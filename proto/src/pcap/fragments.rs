//! Puts the fragments of UDP datagrams together.

use etherparse::defrag::IpDefragBuf;
use etherparse::{IpFragOffset, IpNumber, Ipv6ExtensionSlice, NetSlice, SlicedPacket};

/// Most datagrams that wait for fragments; a further one drops the oldest. Each holds at most
/// 64 KiB, so that all of them together stay within 4 MiB.
const MOST_WAITING: usize = 64;

/// What the fragments of one datagram have in common: addresses and number.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Key {
    source: Vec<u8>,
    destination: Vec<u8>,
    number: u32,
}

/// A part of a UDP datagram.
#[derive(Debug)]
pub(super) struct Fragment<'a> {
    key: Key,
    offset: IpFragOffset,
    more_follow: bool,
    bytes: &'a [u8],
}

impl<'a> Fragment<'a> {
    /// The fragment in a packet; none if the packet is whole.
    pub(super) fn of(packet: &SlicedPacket<'a>) -> Option<Self> {
        let (fragment, protocol) = match packet.net.as_ref()? {
            NetSlice::Ipv4(ip) => {
                let header = ip.header();
                let key = Key {
                    source: header.source().to_vec(),
                    destination: header.destination().to_vec(),
                    number: header.identification().into(),
                };
                let (offset, more_follow) = (header.fragments_offset(), header.more_fragments());
                let bytes = ip.payload().payload;
                (Self { key, offset, more_follow, bytes }, ip.payload().ip_number)
            }
            NetSlice::Ipv6(ip) => {
                let extensions = ip.extensions().clone().into_iter();
                let part = extensions.into_iter().find_map(|extension| match extension {
                    Ipv6ExtensionSlice::Fragment(part) => Some(part.to_header()),
                    _ => None,
                })?;
                let key = Key {
                    source: ip.header().source().to_vec(),
                    destination: ip.header().destination().to_vec(),
                    number: part.identification,
                };
                let (offset, more_follow) = (part.fragment_offset, part.more_fragments);
                let bytes = ip.payload().payload;
                (Self { key, offset, more_follow, bytes }, ip.payload().ip_number)
            }
            NetSlice::Arp(_) => return None,
        };
        let is_part = fragment.more_follow || fragment.offset.value() != 0;
        (is_part && protocol == IpNumber::UDP).then_some(fragment)
    }
}

/// Datagrams of which fragments are missing, the oldest first.
#[derive(Debug, Default)]
pub(super) struct Fragments {
    waiting: Vec<(Key, IpDefragBuf)>,
    dropped_count: u64,
}

impl Fragments {
    /// Datagrams that were given up or still wait for fragments.
    pub(super) fn unfinished_count(&self) -> u64 {
        self.dropped_count + self.waiting.len() as u64
    }

    /// Header and payload of the datagram that this fragment completes.
    pub(super) fn add(&mut self, fragment: &Fragment<'_>) -> Option<Vec<u8>> {
        let at = self.place_of(&fragment.key);
        let buffer = &mut self.waiting[at].1;
        let added = buffer.add(fragment.offset, fragment.more_follow, fragment.bytes);
        if added.is_err() {
            self.waiting.remove(at);
            self.dropped_count += 1;
            return None;
        }
        if !buffer.is_complete() {
            return None;
        }
        Some(self.waiting.remove(at).1.take_bufs().0)
    }

    fn place_of(&mut self, key: &Key) -> usize {
        if let Some(at) = self.waiting.iter().position(|(other, _)| other == key) {
            return at;
        }
        if self.waiting.len() == MOST_WAITING {
            self.waiting.remove(0);
            self.dropped_count += 1;
        }
        let buffer = IpDefragBuf::new(IpNumber::UDP, Vec::new(), Vec::new());
        self.waiting.push((key.clone(), buffer));
        self.waiting.len() - 1
    }
}
