// A table of cells sorted by counting. The including shader defines `reserve_entries`.

var<workgroup> sums: array<u32, CELLS_GROUP>;
var<workgroup> run_start: u32;

// Turns the counts of cells into their first entries, twice: insertion advances the second to the
// end of the cell. The entries of one row of the table are adjacent, rows lie in any order. Thread
// `t` of workgroup `group` of ROW_GROUPS; in uniform control flow.
fn scan_rows(group: u32, t: u32, cells: u32) {
    for (var row = group; row < cells / ROW_CELLS; row += ROW_GROUPS) {
        let first = ROW_CELLS * row + OWN_CELLS * t;
        var counts: array<u32, OWN_CELLS>;
        var total = 0u;
        for (var k = 0u; k < OWN_CELLS; k++) {
            counts[k] = atomicLoad(&table[first + k]);
            total += counts[k];
        }
        sums[t] = total;
        workgroupBarrier();
        for (var reach = 1u; reach < CELLS_GROUP; reach *= 2u) {
            var sum = sums[t];
            if t >= reach {
                sum += sums[t - reach];
            }
            workgroupBarrier();
            sums[t] = sum;
            workgroupBarrier();
        }
        if t == 0u {
            run_start = reserve_entries(sums[CELLS_GROUP - 1u]);
        }
        workgroupBarrier();
        var start = run_start + sums[t] - total;
        for (var k = 0u; k < OWN_CELLS; k++) {
            atomicStore(&table[first + k], start);
            atomicStore(&table[cells + first + k], start);
            start += counts[k];
        }
        workgroupBarrier();
    }
}
