from wormopt.systems.channel.closed_forms import ChannelWorm as ChannelWorm
from wormopt.systems.channel.rod import Rod as Rod
from wormopt.systems.channel.rod_model import channel_rod as channel_rod
