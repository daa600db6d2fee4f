"""Playing a recording: time goes on, is scrubbed, goes round a stretch."""

import pytest

from zeromethod import InputError
from zeromethod.operating.player import Player


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


def called(player: Player, method: str, **arguments: float) -> None:
    future = player.controls.call(method, arguments)
    player.controls.attend()
    future.result(0)


def test_time_goes_on_at_its_speed_up_to_the_end_and_begins_again_when_played(clock):
    player = Player(10.0, now_s=clock)
    clock.now += 2
    assert player.at_s() == pytest.approx(2)
    called(player, "speed", value=2.0)
    clock.now += 1.5
    assert player.at_s() == pytest.approx(5)
    called(player, "pause")
    clock.now += 50
    assert player.at_s() == pytest.approx(5)
    called(player, "play")
    clock.now += 50
    assert (player.at_s(), player.playing) == (10.0, False)
    called(player, "play")
    assert player.at_s() == 0.0


def test_it_is_scrubbed_while_it_plays_and_while_it_does_not(clock):
    player = Player(10.0, now_s=clock)
    called(player, "seek", time_s=7.0)
    clock.now += 1
    assert player.at_s() == pytest.approx(8)
    called(player, "pause")
    called(player, "seek", time_s=99.0)
    assert player.at_s() == 10.0


def test_a_stretch_is_played_over_and_over(clock):
    player = Player(10.0, now_s=clock)
    called(player, "stretch", from_s=2.0, to_s=4.0)
    assert player.at_s() == 2.0
    clock.now += 5
    assert player.at_s() == pytest.approx(3)
    assert player.playing
    with pytest.raises(InputError, match=r"at least 0\.05 s of the recording"):
        called(player, "stretch", from_s=4.0, to_s=3.0)
    called(player, "stretch", from_s=0.0, to_s=99.0)
    assert (player.from_s, player.to_s) == (0.0, 10.0)
