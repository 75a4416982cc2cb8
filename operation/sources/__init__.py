"""Where new records come from: a folder that fills, or an MQTT broker whose messages are first kept in a folder.

`FolderSource` offers files once they are whole; `MqttInbox` writes messages to a folder before it confirms them.
Takes nothing of the other rooms.
"""
