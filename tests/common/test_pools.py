"""Handles: stale ones raise, slots are used again, full pools say so."""

from __future__ import annotations

import random

import pytest

from common.numerics.pools import Handle, Pool, PoolExhaustedError, StaleHandleError


@pytest.mark.feature("device/handle-pools")
def test_create_destroy_create():
    pool = Pool("texture", 4)
    first = pool.create("a")
    assert pool.destroy(first) == "a"
    second = pool.create("b")
    assert second.index == first.index and second.generation != first.generation
    assert pool.get(second) == "b" and not pool.is_alive(first)
    for use in (pool.get, pool.destroy):
        with pytest.raises(StaleHandleError, match="texture 0 of generation 0 was destroyed"):
            use(first)
    assert pool.get(second) == "b"


@pytest.mark.feature("device/handle-pools")
def test_exhaustion():
    pool = Pool("buffer", 3)
    handles = [pool.create(i) for i in range(3)]
    with pytest.raises(PoolExhaustedError, match="pool of 3 buffers is full"):
        pool.create(3)
    pool.destroy(handles[1])
    assert pool.create(4).index == 1


def test_a_handle_of_another_pool_is_refused():
    buffers, textures = Pool("buffer", 3), Pool("texture", 3)
    handle = buffers.create("b")
    textures.create("t")
    with pytest.raises(StaleHandleError, match="buffer handle was given to the pool of textures"):
        textures.get(handle)
    assert not textures.is_alive(handle)
    with pytest.raises(StaleHandleError):
        buffers.get(Handle("buffer", 2, 0))  # a slot that was never used


def test_against_a_dict():
    rng, pool, truth, dead = random.Random(1), Pool("x", 50), {}, []
    for value in range(5_000):
        if rng.random() < 0.5 and len(truth) < 50:
            truth[pool.create(value)] = value
        elif truth:
            handle = rng.choice(list(truth))
            assert pool.destroy(handle) == truth.pop(handle)
            dead.append(handle)
        assert len(pool) == len(truth)
    assert dict(pool.items()) == truth
    assert not any(pool.is_alive(handle) for handle in dead) and len(dead) > 1_000
