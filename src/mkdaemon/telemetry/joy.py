"""A gamepad of another machine on the bus: `joy/<pad>`, after the example of ROS's `sensor_msgs/Joy`."""

from typing import Self

from pydantic import Field, model_validator

from mkdaemon.telemetry.base import Stamped
from mkdaemon.telemetry.signature import Signature, sign


class Joy(Stamped):
    """The whole state of a pad at one moment. Its receiver checks `proof`, and that `sequence` grows."""

    sequence: int = Field(ge=0)
    """Counts up from one message of a pad to the next."""
    name: str = Field(max_length=100)
    """As the pad calls itself."""
    id: str = Field(pattern=r"^[0-9a-f]{4}:[0-9a-f]{4}$")
    """Vendor and product, as in a mapping file."""
    wireless: bool
    """Its driver says that it is reached by Bluetooth."""
    known_age: float = Field(ge=0)
    """Time since the machine of the pad last asked it [s]."""
    axis_names: tuple[str, ...] = Field(max_length=64)
    """Names of the axes, the kernel's."""
    axes: tuple[float, ...] = Field(max_length=64)
    """Where they stand, as a share of their way, -1..1; not turned round."""
    button_names: tuple[str, ...] = Field(max_length=256)
    """Names of the buttons, the kernel's."""
    buttons: tuple[int, ...] = Field(max_length=256)
    """Whether they are pressed, 0 or 1."""
    proof: str = ""
    """HMAC-SHA256 of the message without this field, hexadecimal, by the secret that the flying program shows."""

    @model_validator(mode="after")
    def _names_all(self) -> Self:
        if len(self.axis_names) != len(self.axes) or len(self.button_names) != len(self.buttons):
            msg = "as many names as values are needed"
            raise ValueError(msg)
        return self

    def _content(self) -> bytes:
        return self.model_copy(update={"proof": ""}).model_dump_json().encode()

    def signed(self, secret: str, pad: str) -> Self:
        """Return it with its proof.

        Args:
            secret: of the program that flies.
            pad: last word of its key.
        """
        return self.model_copy(update={"proof": sign(secret, f"joy/{pad}", self._content()).hex()})

    def is_by(self, secret: str, pad: str) -> bool:
        """Whether an owner of the secret sent it."""
        try:
            proof = bytes.fromhex(self.proof)
        except ValueError:
            return False
        return Signature(f"joy/{pad}", self._content(), proof).is_by(secret)
