"""Many references from one file: parts of them are traced by several processes, and merged in order.

    file       what the TOML file asks for: one request of `strata reference` for each combination
    work       a part of a reference, some blocks of its paths, traced in whatever process it comes to
    pools      where parts are traced: in this process, or by Dask's workers here or elsewhere
    merging    sums in the order of the parts, whatever order they end in, and when a reference is finished
    table      one row for each reference
    command    `strata reference --sweep FILE`

A part is a run of the blocks of paths that `strata reference` would trace one after the other (`sums.block_after`). Its
random numbers follow from the numbers of its paths, and its blocks are added in 64 bits in the order of their paths. So
a sweep has the bits of one process, as long as all workers have the same driver and the same kind of processor.
"""
