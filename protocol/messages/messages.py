"""Every message of an open connection, by one name."""

from volsplat.protocol.messages.folder_messages import *  # noqa: F403
from volsplat.protocol.messages.frame_messages import *  # noqa: F403
from volsplat.protocol.messages.image_messages import *  # noqa: F403
from volsplat.protocol.messages.link_messages import *  # noqa: F403
from volsplat.protocol.messages.message import *  # noqa: F403
from volsplat.protocol.messages.plane_messages import *  # noqa: F403
from volsplat.protocol.messages.session_messages import *  # noqa: F403
from volsplat.protocol.messages.slice_messages import *  # noqa: F403
from volsplat.protocol.messages.trace_messages import *  # noqa: F403
from volsplat.protocol.messages.value_messages import *  # noqa: F403
from volsplat.protocol.messages.volume_messages import *  # noqa: F403
