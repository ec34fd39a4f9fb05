//! Rows that follow one another and are of one dwell become a dwell.

use std::collections::BTreeMap;

use super::row::DwellKey;
use super::{PlotRow, RowFault, Scan};
use crate::ids::NodeId;
use crate::wire::{Dwell, Message};

/// Sensors whose revisits are counted; rows of others are refused.
const MAX_SENSOR_COUNT: usize = 256;

/// Joins rows of one sensor, time, revisit and dwell that follow one another.
#[derive(Clone, Debug)]
pub struct Group {
    node: NodeId,
    open: Option<(DwellKey, Scan)>,
    next_revisits: BTreeMap<NodeId, u32>,
}

impl Group {
    /// Rows that do not name their sensor are of `node`.
    #[must_use]
    pub fn new(node: NodeId) -> Self {
        Self { node, open: None, next_revisits: BTreeMap::new() }
    }

    /// Takes a row; gives the dwell that it closes, if it begins another.
    ///
    /// # Errors
    /// If the row makes no sense; it is then left out, and the open dwell goes on.
    pub fn take(&mut self, row: &PlotRow) -> Result<Option<Scan>, RowFault> {
        let key = row.key(&self.node)?;
        let is_full = |scan: &Scan| Dwell::MAX_REPORT_COUNT <= scan.plot_count();
        if let Some((open_key, scan)) = &mut self.open
            && *open_key == key
            && !is_full(scan)
        {
            add(scan, row)?;
            return Ok(None);
        }
        let mut scan = self.begin(&key, row)?;
        add(&mut scan, row)?;
        let revisit_index = match &scan {
            Scan::Geographic(dwell) => dwell.revisit_index,
            Scan::Local(local) => local.revisit_index,
        };
        self.next_revisits.insert(key.node.clone(), revisit_index.wrapping_add(1));
        Ok(self.open.replace((key, scan)).map(|(_, closed)| closed))
    }

    /// The dwell that is still open.
    pub fn finish(&mut self) -> Option<Scan> {
        self.open.take().map(|(_, scan)| scan)
    }

    fn begin(&self, key: &DwellKey, row: &PlotRow) -> Result<Scan, RowFault> {
        let known = self.next_revisits.get(&key.node).copied();
        if known.is_none() && MAX_SENSOR_COUNT <= self.next_revisits.len() {
            let remedy = "rows of more than 256 sensors: split the input";
            return Err(RowFault::Missing { field: "sensor", remedy });
        }
        let revisit_index = key.revisit.or(known).unwrap_or(0);
        if key.is_local {
            return Ok(Scan::Local(row.local_scan(key, revisit_index)?));
        }
        let dwell = row.dwell(key, revisit_index)?;
        dwell.check()?;
        Ok(Scan::Geographic(Box::new(dwell)))
    }
}

fn add(scan: &mut Scan, row: &PlotRow) -> Result<(), RowFault> {
    let index = u32::try_from(scan.plot_count()).unwrap_or(u32::MAX);
    match scan {
        Scan::Local(local) => local.plots.extend(row.local_plot(index)?),
        Scan::Geographic(dwell) => {
            let Some(report) = row.report(index)? else { return Ok(()) };
            report.check()?;
            dwell.reports.push(report);
        }
    }
    Ok(())
}
