//! Promise: garbage on every key of a running centre is counted and named in its log, and nothing
//! else happens.

use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};
use std::time::Duration;

use proto::bus::{Bus, ZenohBus};
use proto::config::BusConfig;
use proto::ids::BootId;
use proto::keys::{Keys, Topic};
use proto::time::NodeTime;
use proto::wire::{ClockProbe, Stamp, encode};

use super::support::eventually;

/// Bytes that are no message of the key that they come under, and a good probe.
fn messages() -> Vec<Vec<u8>> {
    let probe = ClockProbe { node: "n1".parse().unwrap(), asked: NodeTime(1) };
    let good = encode(Stamp { boot: BootId(1), sequence: 0, sent_ns: 0 }, &probe).unwrap();
    let mut other_version = good.clone();
    other_version[4] = 200;
    let mut damaged = good.clone();
    damaged[50] ^= 1;
    let mut oversized = good.clone();
    oversized.resize(1 << 20, 0);
    let cut = good[..good.len() - 1].to_vec();
    let (short, foreign) = (b"garbage".to_vec(), vec![b'x'; 500]);
    vec![short, foreign, other_version, damaged, oversized, cut, good]
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn garbage_is_named_in_the_log_and_the_centre_goes_on() -> anyhow::Result<()> {
    let folder = tempfile::tempdir()?;
    let log = folder.path().join("centre.log");
    let port = std::net::TcpListener::bind(("127.0.0.1", 0))?.local_addr()?.port();
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let mut centre = Command::new(env!("CARGO_BIN_EXE_transmural-under-test"))
        .arg0("fusion-center")
        .args(["--listen", &endpoint, "--stop-with-stdin"])
        .stdin(Stdio::piped())
        .stderr(std::fs::File::create(&log)?)
        .spawn()?;
    let logged = |text: &str| std::fs::read_to_string(&log).is_ok_and(|log| log.contains(text));
    eventually("the centre is up", Duration::from_secs(15), || logged("centre is up"));

    let config = BusConfig { connect: vec![endpoint], ..BusConfig::default() };
    let keys = Keys::new("site".parse()?);
    let (bus, _) = ZenohBus::open(&config, keys, &[]).await?;
    let node: proto::ids::NodeId = "n1".parse()?;
    for bytes in messages() {
        for topic in [
            Topic::Points(node.clone()),
            Topic::Status(node.clone()),
            Topic::ClockProbe(node.clone()),
            Topic::Command,
        ] {
            bus.publish(&topic, bytes.clone()).await?;
        }
    }
    let named = |key: &str, label: &str| {
        let text = std::fs::read_to_string(&log).unwrap_or_default();
        let key = format!("transmural/1/site/{key}");
        text.lines().any(|line| line.contains(&key) && line.contains(label))
    };
    for key in ["up/n1/points", "up/n1/status", "up/n1/clock", "ops/command"] {
        // What is a probe, good or damaged, is of the wrong kind everywhere but under its own key.
        let expected = match key {
            "up/n1/clock" => {
                ["too_short", "foreign", "header_version", "checksum", "oversized", "length"]
            }
            _ => ["too_short", "foreign", "header_version", "kind", "kind", "kind"],
        };
        for label in expected {
            eventually(label, Duration::from_secs(5), || named(key, label));
        }
    }
    bus.close().await;
    assert!(centre.try_wait()?.is_none(), "the centre has ended");
    drop(centre.stdin.take());
    assert!(centre.wait()?.success());
    Ok(())
}
