from wormopt.systems.channel.channel_rod import channel_rod as channel_rod
from wormopt.systems.channel.closed_forms import ChannelWorm as ChannelWorm
from wormopt.systems.channel.rod import Rod as Rod
