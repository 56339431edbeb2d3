"""Many references from one file: parts of them are traced by several processes, and merged in order.

    file       what the TOML file asks for: one request of `strata reference` for each combination
    work       a part of a reference, some blocks of paths of a tile, traced in whatever process it comes to
    pools      where parts are traced: in this process, or by Dask's workers here or elsewhere
    merging    sums in the order of paths and tiles, whatever order parts end in, and when a reference is finished
    table      one row for each reference
    command    `strata reference --sweep FILE`

A part is a run of the blocks of paths that `strata reference` would trace one after the other (`sums.block_after`), of
one tile of the picture (`tiles`). Its random numbers follow from pixels and the numbers of its paths, and blocks of all
tiles are added in 64 bits in the order of their paths. So a sweep has the bits of one process, as long as all workers
have the same driver and the same kind of processor. A worker that ends costs the part it was tracing.
"""
